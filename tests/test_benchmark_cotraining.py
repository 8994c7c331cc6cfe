"""Co-training benchmark: a slow camera, masks at recorded poses, gains."""

import numpy as np

from benchmarks.cotraining import SlowCamera, gains, masks_at
from embodiedreamer_gym.envs.aloha import AlohaEnv


class Counting:
    def __init__(self):
        self.taken = 0

    def __call__(self, poses):
        self.taken += 1
        return np.full((2, 2, 3), self.taken, np.uint8)


def test_a_slow_camera_shows_its_last_picture_until_the_next_is_due():
    camera, seen = SlowCamera(Counting()), []
    for step in range(6):
        camera.due = step % 3 == 0
        seen.append(int(camera({})[0, 0, 0]))
    assert seen == [1, 1, 1, 2, 2, 2]


def test_masks_show_an_object_where_it_is():
    env = AlohaEnv("PutCupOnMat", obs_type="state", renderer="tiny")
    env.reset(seed=3)
    rest = env.joint_positions()
    objects = {}
    for name in ("cup", "mat"):
        pose = env.object_pose(name)
        objects[name] = np.tile(np.concatenate([pose.position, pose.quaternion]), (2, 1))
    env.close()
    objects["cup"][1, 1] += 0.1  # m, to the robot's left, which is the left of the picture
    masks, classes = masks_at("PutCupOnMat", np.tile(rest, (2, 1)), objects)
    columns = [np.nonzero(mask == classes.index("cup"))[1].mean() for mask in masks]
    assert columns[1] < columns[0] - 5
    assert (masks[0] == classes.index("mat")).sum() == (masks[1] == classes.index("mat")).sum()


def test_gains_compare_the_same_scenes():
    rows = [{"task": "A", "kind": "real", "seeds": "0011"}, {"task": "A", "kind": "both", "seeds": "0111"}]
    (gain,) = gains(rows)
    assert gain["gain"] == 25.0
    np.testing.assert_allclose(gain["error"], 100 * np.std([0, 1, 0, 0], ddof=1) / 2)
