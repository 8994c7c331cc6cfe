"""Recorded episodes with other pictures: their actions are replayed, and VisAligner films them, from edited references."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.fingerprint import check_settings
from embodiedreamer_gym.io.parallel import each
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.pipelines.replay_episodes import Played, Source, play, read_source, source_files
from embodiedreamer_gym.recordings.episodes import frames_of, write_aloha_episode
from embodiedreamer_gym.recordings.episodes.aloha import AlohaEpisodes
from embodiedreamer_gym.recordings.hdf5 import read_settings
from embodiedreamer_gym.vis_aligner import Aligner, Bank, References, generate, load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.editing import ReferenceEditor, describe, draws_of, edited, masks_of

RECIPE = 2  # to be raised with whatever changes the episodes of the same settings
ABOUT = "augmentation"  # the attribute that tells how an episode was made
OWN = (
    "sim",
    "compress",
    "rate",
    "instruction",
    "renderer",
    "demonstration",
    ABOUT,
)  # attributes that are not taken over
CAMERA = "head"


@dataclass(frozen=True)
class Regenerated:
    """What became of recorded episodes: files written, files that were there, and the names of those whose replay failed."""

    written: int
    kept: int
    failed: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Work:
    """What is the same for all episodes; bank None: each starts from its own first frame."""

    folder: Path
    aligner: Aligner
    bank: Bank | None
    editor: ReferenceEditor | None
    settings: dict[str, Any]

    def edit_seed(self, source: Source, copy: int) -> int:
        """Seed of an edit, whatever the number of episodes and copies."""
        key = [self.settings["seed"], zlib.crc32(f"{source.task}/{source.name}".encode()), copy]
        return int(np.random.SeedSequence(key).generate_state(1)[0])

    def path(self, name: str, copy: int) -> Path:
        """Where a copy of an episode goes."""
        return self.folder / f"{name}_{copy}.hdf5"


def regenerate(
    episodes: str | Path | Sequence[str | Path], folder: str | Path, aligner: str = "lean", bank: str | None = "lab",
    editor: ReferenceEditor | None = None, copies: int = 1, seed: int = 0, progress: ProgressCallback | None = None, *,
    prompt: str | None = None, task: str | None = None, robot: str | None = None, jobs: int = 1,
) -> Regenerated:  # fmt: skip
    """Write `<episode>_<copy>.hdf5` of recorded episodes into a folder: action and state as recorded, other frames.

    episodes: ALOHA HDF5 files or folders of them, as `embodiedreamer demos` writes them, or logs that hold where the objects
    were (`/objects/<name>`); the actions are played from the same start, and an episode whose replay does not end in
    success is left out. Frames are the aligner's, of the head camera; bank: photos from which the first one is painted, or
    None for the episode's own first frame (a real one); editor: changes it, None leaves it; prompt: for an editor that
    takes words. copies: of each episode, edited with other draws; what is there is kept, and a run that was interrupted
    goes on. task, robot: where the files do not say them, or in their place; jobs: processes.
    Raises: RecordingError for episodes that cannot be replayed or a folder with others; VisionError, SimulationError,
    ModelError for what else does not fit.
    """
    if copies < 1 or seed < 0 or jobs < 1:
        raise RecordingError(f"copies and jobs must be at least 1, seed at least 0, not {copies}, {jobs} and {seed}.")
    if editor is None and copies > 1:
        raise RecordingError(f"without an edit all {copies} copies would be the same; give an editor, or copies=1.")
    sources = [read_source(path, task, robot) for path in source_files(episodes)]
    settings = {
        "recipe": RECIPE, "aligner": str(aligner), "bank": bank, "edit": None if editor is None else describe(editor),
        "prompt": prompt, "seed": seed, "task": task, "robot": robot,
    }  # fmt: skip
    work = _Work(
        Path(folder), load_aligner(aligner), None if bank is None else load_bank(bank), editor, settings
    )  # fmt: skip
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
    """Replay one episode and write the copies that are not there."""
    paths = [work.path(source.name, copy) for copy in range(copies)]
    wanted = [copy for copy, path in enumerate(paths) if not path.is_file()]
    for path in paths:
        if path.is_file() and not _same(source, AlohaEpisodes([path])):
            raise RecordingError(f"{path} was made of another {source.name} than {source.path}; give another folder.")
    if not wanted:
        return 0
    recorded = AlohaEpisodes([source.path])
    own = _own_frame(recorded, source) if work.bank is None else None
    size = work.bank.size if work.bank is not None else recorded.frame_size(CAMERA)
    played = play(source, size, CAMERA)
    if not played.success:
        return None
    start = References.start(own, played.condition.part(0, 1)) if own is not None else _painted(work, played)
    for copy in wanted:
        _write(work, source, copy, played, start)
    return len(wanted)


def _same(source: Source, made: AlohaEpisodes) -> bool:
    """Whether an episode that is there was made of this one: states and actions are taken over to the bit."""
    return np.array_equal(made.actions(0), source.actions) and np.array_equal(made.states(0), source.states)


def _own_frame(recorded: AlohaEpisodes, source: Source) -> np.ndarray:
    """The first frame (H, W, 3) of an episode."""
    if CAMERA not in recorded.cameras:
        raise RecordingError(f"{source.path} has no frames of the camera '{CAMERA}' to start from; give a bank.")
    return next(frames_of(recorded, 0, CAMERA))


def _painted(work: _Work, played: Played) -> References:
    """References of a first frame that is painted from photos."""
    if work.bank is None:
        raise RecordingError("there is neither a bank nor a first frame to start from.")
    return work.bank.of(played.names[3:]).start(played.condition)


def _write(work: _Work, source: Source, copy: int, played: Played, start: References) -> None:
    """Edit, generate and write one copy."""
    about: dict[str, Any] = {**work.settings, "source": source.name, "copy": copy}
    if work.editor is not None:
        own, prompt = work.edit_seed(source, copy), work.settings["prompt"]
        draws = draws_of(work.editor, masks_of(played.condition, played.names), own)
        start = edited(start, work.editor, own, prompt, played.names)
        about |= {"edit_seed": own, "draws": draws}
    about["replay_error"] = played.error
    frames = generate(work.aligner, [start], [played.condition.part(1, len(played.condition))])[0][0]
    attributes = {key: value for key, value in source.attributes.items() if key not in OWN}
    write_aloha_episode(
        work.path(source.name, copy), source.states, source.actions, {CAMERA: iter([start.last, *frames])},
        source.instruction, hz=source.hz, images="gzip", velocities=source.velocities, efforts=source.efforts,
        objects=source.objects, masks={CAMERA: played.condition.classes}, classes=played.names,
        attributes={**attributes, ABOUT: about},
    )  # fmt: skip


def _check_folder(folder: Path, settings: dict[str, Any]) -> None:
    """Make the folder, and raise where it holds other episodes than those of these settings."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder} cannot be made a folder: {error.strerror}; give another place.") from error
    for path in sorted(p for p in folder.iterdir() if p.suffix in (".hdf5", ".h5") and not p.name.startswith(".")):
        check_settings(path, read_settings(path, ABOUT, "generated episode"), settings)
