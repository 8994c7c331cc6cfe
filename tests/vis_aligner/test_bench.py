"""A bench without robot and objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.bench import PICTURES, grain_of, make_bench, make_gallery, with_benches
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, Condition, facings
from tests.vis_aligner.scenes import episode, texture
from tests.vis_aligner.test_reprojection import board


def test_a_backdrop_is_the_bench() -> None:
    """To within a fraction of the sensor's noise, also where an arm stands in most pictures, and nowhere a thing."""
    episodes = [episode(seed) for seed in range(10)]
    found = make_bench(episodes)
    error = np.abs(found.picture.astype(float) - texture(0)).max(axis=2)[found.seen]
    assert np.median(error) <= 1 and np.percentile(error, 90) < 4  # the rest: shadows that never leave
    often = np.mean([(e.condition.classes >= ROBOT).mean(axis=0) for e in episodes], axis=0) > 0.3
    assert (often & found.seen).sum() > 20
    never = np.all([(e.condition.classes >= ROBOT).all(axis=0) for e in episodes], axis=0)
    assert not (found.seen & never).any() and not found.picture[~found.seen].any()


def test_what_was_seen_once_counts() -> None:
    """Also in a picture that is not among those of the median."""
    frames = np.full((2 * PICTURES + 1, 8, 8, 3), 50, np.uint8)
    classes = np.full(frames.shape[:3], ROBOT, np.uint8)
    classes[1], frames[1] = 0, 123  # an odd number: left out of PICTURES evenly drawn ones
    found = make_bench([Episode("once", frames, Condition(frames, classes))])
    assert found.seen.all() and (found.picture == 123).all()


def test_each_bench_has_its_own() -> None:
    ones = [replace(episode(seed), appearance=bench) for seed, bench in ((0, "a"), (1, "b"), (2, "a"))]
    dark = replace(ones[1], frames=ones[1].frames // 2)
    a, b, again = with_benches([ones[0], dark, ones[2]])
    assert a.bench is not None and again.bench is not None and b.bench is not None
    assert a.bench.picture is again.bench.picture
    assert b.bench.picture[b.bench.seen].mean() < 0.6 * a.bench.picture[a.bench.seen].mean()


def test_a_gallery_has_poses_that_differ_and_none_of_the_episode_itself() -> None:
    """A board that turns: pictures from all around, none twice, of links and not of objects."""
    turning = [board([(0.0, 0.0, 1.0, 0.0)] * 5 + [(0.0, 0.0, 1.0, a) for a in (0.5, 1.0, 1.5)]) for _ in range(2)]
    angles = (0.0, 0.4, 0.8, 1.2)
    leaning = [tilted(clip, angles) for clip in turning]
    one, two = (Episode(str(k), c.rgb + np.uint8(k), c, appearance="a") for k, c in enumerate(leaning))
    found = make_gallery([one, two], 4)
    assert found is not None and len(found) == 4
    axes = facings(found.condition)[:, 0]
    assert min(np.linalg.norm(axes[i] - axes[j]) for i in range(4) for j in range(i)) > 0.3
    first, second = with_benches([one, two])
    assert (first.bench.gallery.frames[:, 0, 0, 0] == two.frames[0, 0, 0, 0]).all()
    assert (second.bench.gallery.frames[:, 0, 0, 0] == one.frames[0, 0, 0, 0]).all()
    assert with_benches([one])[0].bench.gallery is None
    bare = replace(one.condition, classes=np.where(one.condition.classes == ROBOT, OBJECT, one.condition.classes))
    assert make_gallery([replace(one, condition=bare)]) is None


def test_cameras_in_two_places_share_the_robots_photos_and_no_plate() -> None:
    clip = board([(0.0, 0.0, 1.0, angle) for angle in (0.0, 0.5, 1.0, 1.5)])
    here, there = (
        Episode(name, clip.rgb // 2 + np.uint8(k), tilted(clip, (k, k + 0.1, k + 0.2, k + 0.3)), appearance=f"a/{name}")
        for k, name in ((0, "1"), (1, "2"))
    )
    one, two = with_benches([here, there])
    assert (one.bench.gallery.frames[:, 0, 0, 0] == there.frames[0, 0, 0, 0]).all()
    assert (two.bench.gallery.frames[:, 0, 0, 0] == here.frames[0, 0, 0, 0]).all()
    assert (two.bench.picture.astype(int) - one.bench.picture)[one.bench.seen].min() == 1
    found = make_bench([here], [there])
    assert len(found.gallery) == 8 and (found.picture == one.bench.picture).all()
    assert len(np.unique(found.gallery.frames[:, 0, 0, 0])) == 2


def tilted(clip: Condition, angles) -> Condition:
    """The condition, its part turned away from the camera by some angles, one after the other."""
    projections = clip.projections.copy()
    for k in range(len(clip)):
        angle = angles[k % len(angles)]
        projections[k, 0, 2, :3] = (np.sin(angle), 0.0, np.cos(angle))
    return replace(clip, projections=projections)


def test_nothing_gives_no_backdrop() -> None:
    with pytest.raises(VisionError, match="at least one episode"):
        make_bench([])


def test_the_sensors_grain_is_that_of_frames_that_follow_each_other() -> None:
    for noise in (1.0, 2.0, 5.0):
        assert grain_of([episode(seed, noise=noise) for seed in range(3)]) == pytest.approx(noise, rel=0.1)
    assert grain_of([]) is None
