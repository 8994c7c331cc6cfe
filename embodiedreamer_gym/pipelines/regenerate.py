"""Recorded episodes with new pictures: actions are replayed, and VisAligner generates frames from edited references."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.fingerprint import check_settings
from embodiedreamer_gym.io.parallel import each
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.pipelines.replay_episodes import Played, Source, play, read_source, source_files
from embodiedreamer_gym.recordings.episodes import frames_of, write_aloha_episode
from embodiedreamer_gym.recordings.episodes.aloha import AlohaEpisodes
from embodiedreamer_gym.recordings.hdf5 import read_settings
from embodiedreamer_gym.vis_aligner import Aligner, Bank, Condition, References, generate, load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.condition import OBJECT
from embodiedreamer_gym.vis_aligner.editing import ReferenceEditor, describe, draws_of, edited, masks_of

RECIPE = 2  # raise it with any change that alters the episodes of the same settings
ABOUT = "augmentation"  # the attribute that states how an episode was made
OWN = (
    "sim",
    "compress",
    "rate",
    "instruction",
    "renderer",
    "demonstration",
    ABOUT,
)  # attributes that are not copied
CAMERA = "head"


@dataclass(frozen=True)
class Regenerated:
    """Result: number of files written, of files that existed, and names of the episodes whose replay failed."""

    written: int
    kept: int
    failed: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Work:
    """Inputs that all episodes share.

    bank: None if each starts from its own first frame; moving_aligner: of wrist cameras.
    """

    folder: Path
    aligner: Aligner
    moving_aligner: Aligner
    bank: Bank | None
    editor: ReferenceEditor | None
    cameras: tuple[str, ...]
    settings: dict[str, Any]

    def frames(self, start: References, view: Condition) -> np.ndarray:
        """All frames (T, H, W, 3) of a view; the first is the one to start from."""
        aligner = self.moving_aligner if view.moving_camera else self.aligner
        return np.stack([start.last, *generate(aligner, [start], [view.part(1, len(view))])[0][0]])

    def edit_seed(self, source: Source, copy: int) -> int:
        """Seed of an edit, independent of the number of episodes and copies."""
        key = [self.settings["seed"], zlib.crc32(f"{source.task}/{source.name}".encode()), copy]
        return int(np.random.SeedSequence(key).generate_state(1)[0])

    def path(self, name: str, copy: int) -> Path:
        """Path of a copy of an episode."""
        return self.folder / f"{name}_{copy}.hdf5"


def regenerate(
    episodes: str | Path | Sequence[str | Path], folder: str | Path, aligner: str = "lean", bank: str | None = "lab",
    editor: ReferenceEditor | None = None, copies: int = 1, seed: int = 0, progress: ProgressCallback | None = None, *,
    prompt: str | None = None, task: str | None = None, robot: str | None = None, jobs: int = 1,
    cameras: Sequence[str] = (CAMERA,), moving_aligner: str = "assembled",
) -> Regenerated:  # fmt: skip
    """Write recorded episodes to a folder as `<episode>_<copy>.hdf5`: with recorded actions and states, and new frames.

    The actions are played from the same start; an episode whose replay does not end in success is left out. Existing copies
    are kept, and an interrupted run continues.

    episodes: ALOHA HDF5 files or folders of them, as `embodiedreamer demos` writes them, or logs with the objects'
    poses (`/objects/<name>`); bank: photos from which the first frame is composed, or None for the episode's own (real)
    first frame; editor: changes the first frame, None for no change; prompt: for an editor that takes text; copies:
    number of copies of each episode, with different draws of the edit; task, robot: override those in the files, or
    supply missing ones; jobs: number of processes; cameras: names
    of the cameras whose frames are generated; moving_aligner: the aligner of wrist cameras, which need a bank with their
    photos, or the episode's own first frame.
    Raises: RecordingError for episodes that cannot be replayed, or a folder with other episodes; VisionError,
    SimulationError or ModelError for other arguments that do not fit.
    """
    if copies < 1 or seed < 0 or jobs < 1:
        raise RecordingError(f"copies and jobs must be at least 1, seed at least 0, not {copies}, {jobs} and {seed}.")
    if editor is None and copies > 1:
        raise RecordingError(f"without an edit all {copies} copies would be the same; give an editor, or copies=1.")
    cameras = check_cameras(cameras, editor is not None)
    sources = [read_source(path, task, robot) for path in source_files(episodes)]
    settings = {
        "recipe": RECIPE, "aligner": str(aligner), "bank": bank, "edit": None if editor is None else describe(editor),
        "prompt": prompt, "seed": seed, "task": task, "robot": robot,
    }  # fmt: skip
    several = cameras != (CAMERA,)  # files of the head camera alone do not name it
    settings |= {
        "cameras": list(cameras) if several else None,
        "moving_aligner": str(moving_aligner) if several else None,
    }
    photos = None if bank is None else load_bank(bank)
    work = _Work(Path(folder), load_aligner(aligner), load_aligner(moving_aligner), photos, editor, cameras, settings)
    _check_folder(work.folder, settings)
    written, kept, failed, shown = 0, 0, [], progress_or_silence(progress)
    results = each(_episode, [(work, source, copies) for source in sources], jobs)
    for number, (source, made) in enumerate(zip(sources, results, strict=True), 1):
        if made is None:
            failed.append(source.name)
        else:
            written, kept = written + made, kept + copies - made
        shown("replaying episodes", number, len(sources), failed=len(failed))
    return Regenerated(written, kept, tuple(failed))


def _episode(work: _Work, source: Source, copies: int) -> int | None:
    """Replay one episode and write the missing copies."""
    paths = [work.path(source.name, copy) for copy in range(copies)]
    wanted = [copy for copy, path in enumerate(paths) if not path.is_file()]
    for path in paths:
        if path.is_file() and not _same(source, AlohaEpisodes([path])):
            raise RecordingError(
                f"{path} was made from a different episode {source.name} than {source.path}; give another folder."
            )
    if not wanted:
        return 0
    recorded = AlohaEpisodes([source.path])
    own = {name: _own_frame(recorded, source, name) for name in work.cameras} if work.bank is None else {}
    if len({frame.shape for frame in own.values()}) > 1:
        raise RecordingError(f"{source.path}: the frames of {', '.join(own)} have different sizes; choose one camera.")
    size = work.bank.size if work.bank is not None else recorded.frame_size(work.cameras[0])
    played = play(source, size, work.cameras)
    if not played.success:
        return None
    starts = {name: _start(work, view, played.names, own.get(name)) for name, view in played.views.items()}
    for copy in wanted:
        _write(work, source, copy, played, starts)
    return len(wanted)


def _same(source: Source, made: AlohaEpisodes) -> bool:
    """Whether an existing episode was made from this one; states and actions are copied bit for bit."""
    return np.array_equal(made.actions(0), source.actions) and np.array_equal(made.states(0), source.states)


def _own_frame(recorded: AlohaEpisodes, source: Source, camera: str) -> np.ndarray:
    """The first frame (H, W, 3) of an episode."""
    if camera not in recorded.cameras:
        raise RecordingError(f"{source.path} has no frames of the camera '{camera}' to start from; give a bank.")
    return next(frames_of(recorded, 0, camera))


def _start(work: _Work, view: Condition, names: Sequence[str], own: np.ndarray | None) -> References:
    """References of a camera: with its own first frame, or one that is composed from photos."""
    if own is not None:
        return References.start(own, view.part(0, 1))
    if work.bank is None:
        raise RecordingError("there is neither a bank nor a first frame to start from.")
    return work.bank.of(names[OBJECT:]).start(view)


def _write(work: _Work, source: Source, copy: int, played: Played, starts: Mapping[str, References]) -> None:
    """Edit, generate and write one copy."""
    about: dict[str, Any] = {**work.settings, "source": source.name, "copy": copy}
    if work.editor is not None:
        ((camera, start),) = starts.items()
        own, prompt = work.edit_seed(source, copy), work.settings["prompt"]
        draws = draws_of(work.editor, masks_of(played.views[camera], played.names), own)
        starts = {camera: edited(start, work.editor, own, prompt, played.names)}
        about |= {"edit_seed": own, "draws": draws}
    about["replay_error"] = played.error
    frames = {name: work.frames(start, played.views[name]) for name, start in starts.items()}
    masks = {name: view.classes for name, view in played.views.items()}
    attributes = {key: value for key, value in source.attributes.items() if key not in OWN}
    write_aloha_episode(
        work.path(source.name, copy), source.states, source.actions, {name: iter(clip) for name, clip in frames.items()},
        source.instruction, hz=source.hz, images="gzip", velocities=source.velocities, efforts=source.efforts,
        objects=source.objects, masks=masks, classes=played.names,
        attributes={**attributes, ABOUT: about},
    )  # fmt: skip


def check_cameras(cameras: Sequence[str], edits: bool) -> tuple[str, ...]:
    """Names of cameras.

    Raises: RecordingError for none, for one twice or that is not known, or for several if first frames are edited.
    """
    names = tuple(cameras)
    if not names or len(set(names)) < len(names) or not set(names) <= set(CAMERAS):
        raise RecordingError(f"the cameras are one or more of {', '.join(CAMERAS)}, not {', '.join(names) or 'none'}.")
    if edits and len(names) > 1:
        raise RecordingError("an edit changes the frames of one camera; give one camera, or no edit.")
    return names


def _check_folder(folder: Path, settings: dict[str, Any]) -> None:
    """Make the folder, and raise if it holds episodes of other settings."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder} cannot be made a folder: {error.strerror}; give another place.") from error
    for path in sorted(p for p in folder.iterdir() if p.suffix in (".hdf5", ".h5") and not p.name.startswith(".")):
        check_settings(path, read_settings(path, ABOUT, "generated episode"), settings)
