"""`embodiedreamer vis prepare`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli import vis_inputs as i
from embodiedreamer_gym.errors import EmbodieDreamerError


@o.verb(
    o.option("episodes", "REC", o.FILES, o.REQUIRED, nargs="+"),
    o.option("--model", "M", i.URDF, "aloha"),
    i.JOINTS,
    i.CAMERAS,
    i.CAMERA,
    o.option("--masks", "DIR", "masks DIR/<recording>/000000.png, ...: 0 none, 3 object, 4 goal", None, Path),
    o.option("--detector", "DIR", "masks from text: local folder with Grounding DINO", None, Path),
    o.option("--segmenter", "DIR", "masks from text: local folder with SAM", None, Path),
    o.option("--object", "WORDS", "description of the object, e.g. 'red cup'"),
    o.option("--goal", "WORDS", "description of the goal, e.g. 'blue mat'"),
    o.DEVICE,
    o.option(
        "--table",
        "Z",
        "height of the table top, m, z in the robot's frame; needed for a camera that is mounted on a link",
        None,
        o.number(float, -1e3, 1e3),
    ),
    o.HZ,
    o.SIZE,
    o.out_folder("output folder of <recording>.hdf5, ..."),
    o.QUIET,
)
def run(a, progress):
    """Prepare real recordings with video for training: add the simulator's view."""
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.pipelines.prepare import prepare, write_episode
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.vis_aligner.camera_calibration.inputs import camera_name

    size = read_size(a.size)
    cameras = i.load_camera_file(a)
    masks = _masks(a)
    model = i.robot_model(a)
    recordings = load_recordings(*a.episodes, hz=a.hz, joints=model.joints)
    used = [i.camera_of(cameras, camera_name(a.camera, one), one.name) for one in recordings]
    for recording, camera in zip(recordings, used, strict=True):
        episode = prepare(recording, model, camera, size, masks(recording.name), progress, a.table)
        a.out.mkdir(parents=True, exist_ok=True)
        write_episode(episode, a.out / f"{recording.name}.hdf5")
    return f"{len(recordings)} episodes in {a.out}"


def _masks(a) -> Callable[[str], Any]:
    """Return a function that gives a recording's object masks by its name."""
    from embodiedreamer_gym.vis_aligner.grounded import grounded
    from embodiedreamer_gym.vis_aligner.masks import masks_in, no_masks

    words = {number: text for number, text in ((3, a.object), (4, a.goal)) if text}
    models = [path for path in (a.detector, a.segmenter) if path is not None]
    if (words or models) and (not words or len(models) != 2 or a.masks is not None):
        raise EmbodieDreamerError(
            "masks from text need --detector, --segmenter and --object or --goal, and no --masks; give all, or none."
        )
    if words:
        by_words = grounded(a.detector, a.segmenter, words, device=a.device)
        return lambda name: by_words
    return lambda name: no_masks if a.masks is None else masks_in(a.masks / name)
