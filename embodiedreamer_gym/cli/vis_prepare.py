"""`embodiedreamer vis prepare`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli.options import MODEL, QUIET, REC, REQUIRED, SIZE, option, out_folder
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import check_outputs

TEXT = "episodes to learn from, of real recordings with video: adds the simulator's view"
OPTIONS = (
    option("episodes", "REC", REC, REQUIRED, nargs="+"),
    option("--model", "M", MODEL, "aloha"),
    option("--cameras", "FILE", "calibrated cameras (default: the built-in ones)", None, Path),
    option("--camera", "NAME", "whose video", "head"),
    option("--masks", "DIR", "DIR/<recording>/000000.png, ...: 0, 3 object, 4 goal", None, Path),
    option("--detector", "DIR", "masks from words: a Grounding DINO, a local folder", None, Path),
    option("--segmenter", "DIR", "and a SAM, a local folder", None, Path),
    option("--object", "WORDS", "what the object is, e.g. 'red cup'"),
    option("--goal", "WORDS", "what its goal is, e.g. 'blue mat'"),
    SIZE,
    out_folder("<recording>.hdf5, ..."),
    QUIET,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.envs.cameras import CAMERAS, load_cameras
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.pipelines.prepare import prepare, write_episode
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.robot import RobotModel

    check_outputs(folders=[a.out])
    size = read_size(a.size)
    cameras = CAMERAS if a.cameras is None else load_cameras(a.cameras)
    if a.camera not in cameras:
        raise EmbodieDreamerError(f"there is no camera '{a.camera}'; there are {', '.join(cameras)}.")
    masks = _masks(a)
    model, recordings = RobotModel.load(a.model), load_recordings(*a.episodes)
    for recording in recordings:
        episode = prepare(recording, model, cameras[a.camera], size, masks(recording.name), progress)
        a.out.mkdir(parents=True, exist_ok=True)
        write_episode(episode, a.out / f"{recording.name}.hdf5")
    progress.close()
    print(f"{len(recordings)} episodes in {a.out}")


def _masks(a) -> Callable[[str], Any]:
    """Where the objects are in the frames of a recording, by its name."""
    from embodiedreamer_gym.vis_aligner.grounded import grounded
    from embodiedreamer_gym.vis_aligner.masks import masks_in, no_masks

    words = {number: text for number, text in ((3, a.object), (4, a.goal)) if text}
    models = [path for path in (a.detector, a.segmenter) if path is not None]
    if (words or models) and (not words or len(models) != 2 or a.masks is not None):
        raise EmbodieDreamerError(
            "masks from words need --detector, --segmenter and --object or --goal, and no --masks; give all, or none."
        )
    if words:
        by_words = grounded(a.detector, a.segmenter, words)
        return lambda name: by_words
    return lambda name: no_masks if a.masks is None else masks_in(a.masks / name)
