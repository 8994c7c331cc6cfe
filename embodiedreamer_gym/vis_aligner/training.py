"""Trains an aligner on episodes, with chunks that follow true references or the model's own last frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.learning.processes import Processes
from embodiedreamer_gym.learning.training import CHECKPOINT, Training, TrainingSettings, train_in_folder
from embodiedreamer_gym.vis_aligner.aligner import Trainable
from embodiedreamer_gym.vis_aligner.bench import with_benches
from embodiedreamer_gym.vis_aligner.clip import Episode, References
from embodiedreamer_gym.vis_aligner.condition import OBJECT, Condition

RENAMED = {"rate": "learning_rate", "told": "bench_share", "own": "own_reference_share"}  # names of version 0.1


@renamed_arguments(**RENAMED)
@dataclass(frozen=True)
class TrainingConfig(TrainingSettings):
    """Settings of an aligner's training; an example is a clip of one chunk.

    Raises: VisionError for numbers out of range.
    """

    batch: int = 2
    """Clips per step."""
    weight_decay: float = 1e-3
    """Weight decay of AdamW."""
    average: float = 0.998
    """Share of the running average of the weights that each step keeps."""
    bench_share: float = 0.7
    """Share of sequences with known bench and object poses; the others have only what is known of a real clip."""
    own_reference_share: float = 0.8
    """Probability that a clip is followed by the next one of its episode, with the model's own last frame as reference."""

    def __post_init__(self) -> None:
        """Check."""
        self.check(VisionError, bench_share=self.bench_share, own_reference_share=self.own_reference_share)


@dataclass(frozen=True, eq=False)
class Position:
    """Position of the training in an episode.

    episode: number of the episode.
    at: the frame that the references show.
    with_bench: whether the bench and the objects' poses are known.
    last, plate: pictures (H, W, 3) that the model generated, if any.
    """

    episode: int
    at: int
    with_bench: bool
    last: Tensor | None = None
    plate: Tensor | None = None

    def references(self, episodes: Sequence[Episode]) -> References:
        """References of the next chunk."""
        one = episodes[self.episode]
        true = one.references(self.at, one.bench if self.with_bench else None).viewed(self._visible)
        if self.last is None or self.plate is None:
            return true
        return replace(true, last=self.last.numpy(), plate=self.plate.numpy())

    def condition(self, episodes: Sequence[Episode], frames: int) -> Condition:
        """The condition of the next chunk."""
        return self._visible(episodes[self.episode].condition.part(self.at + 1, self.at + 1 + frames))

    def _visible(self, condition: Condition) -> Condition:
        """The condition without the objects' poses, unless they are known."""
        return condition if self.with_bench else condition.without_parts(OBJECT)


class AlignerTraining(Training):
    """Training of an aligner on the episodes that are longer than a chunk.

    With several processes, each draws its own clips; after an interruption, their sequences start from new positions.
    Raises: VisionError where no episode is longer than a chunk.
    """

    config: TrainingConfig

    def __init__(
        self,
        aligner: Trainable,
        episodes: Sequence[Episode],
        config: TrainingConfig,
        processes: Processes | None = None,
    ) -> None:
        super().__init__(aligner.network, config, VisionError, processes)
        self.aligner, self.episodes = aligner, [e for e in episodes if len(e) > aligner.chunk]
        if not self.episodes:
            raise VisionError(f"no episode is longer than {aligner.chunk} frames; record longer ones.")
        self.positions: list[Position | None] = [None] * config.batch
        self._next_positions: Callable[[], list[Position | None]] = list

    def finish(self) -> None:
        """Load the averaged weights into the network."""
        self.network.load_state_dict(self.averaged)

    def loss(self, step: int) -> dict[str, Tensor]:
        """The aligner's loss of a batch of clips."""
        rng = np.random.default_rng([self.config.seed, step, *([self.processes.index] * (self.processes.count > 1))])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        k, episodes = self.aligner.chunk, self.episodes
        positions = [self.begin(rng) if one is None else one for one in self.positions]
        conditions = [one.condition(episodes, k) for one in positions]
        truth = [episodes[one.episode].frames[one.at + 1 : one.at + 1 + k] for one in positions]
        references = [one.references(episodes) for one in positions]
        loss, made = self.aligner.attempt(references, conditions, truth, generator)

        def next_positions() -> list[Position | None]:
            after: list[Position | None] = [None] * len(positions)
            share = self.config.own_reference_share
            going = [one.at + 2 * k < len(episodes[one.episode]) and rng.random() < share for one in positions]
            for i, frames in enumerate(made() if any(going) else ()):
                if going[i]:
                    reached = references[i].after(frames, conditions[i])
                    pictures = torch.tensor(reached.last), torch.tensor(reached.plate)
                    after[i] = Position(positions[i].episode, positions[i].at + k, positions[i].with_bench, *pictures)
            return after

        self._next_positions = next_positions
        return {"loss": loss}

    def advance(self, step: int) -> dict[str, float]:
        """One step of the optimiser."""
        row = super().advance(step)
        self.positions = self._next_positions()
        return row

    def begin(self, rng: np.random.Generator) -> Position:
        """A new position at a true frame, drawn uniformly from the frames of all episodes."""
        ends = np.cumsum([len(e) - self.aligner.chunk for e in self.episodes])
        drawn = int(rng.integers(ends[-1]))
        number = int(np.searchsorted(ends, drawn, side="right"))
        return Position(number, int(ends[number]) - 1 - drawn, bool(rng.random() < self.config.bench_share))

    # ---- files -------------------------------------------------------------------------------------------------

    def identity(self) -> dict[str, Any]:
        """Lengths of the episodes."""
        return {"episodes": [len(e) for e in self.episodes]}

    def state(self) -> dict[str, Any]:
        """The position of each clip of the batch."""
        return {"positions": [None if one is None else vars(one) for one in self.positions]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore the positions from `state`."""
        positions = [None if one is None else Position(**one) for one in state["positions"]]
        if len(positions) != self.config.batch:
            raise ValueError("positions belong to another batch")
        for one in positions:
            if one is not None:
                episode = self.episodes[one.episode]
                wrong = [
                    x for x in (one.last, one.plate) if x is not None and x.numpy().shape != episode.frames.shape[1:]
                ]
                if wrong or not 0 <= one.at < len(episode) - self.aligner.chunk:
                    raise ValueError("a position is outside its episode")
        if self.processes.count == 1:
            self.positions = positions

    def migrate(self, state: dict[str, Any]) -> dict[str, Any]:
        """A checkpoint of version 0.1 with the present names."""
        if "walks" not in state:
            return state
        settings = {RENAMED.get(name, name): value for name, value in dict(state["config"]).items()}
        names = {"told": "with_bench"}
        positions = [one and {names.get(k, k): v for k, v in dict(one).items()} for one in state["walks"]]
        return {**state, "training": settings, "episodes": state["data"], "positions": positions}


def train(aligner: Trainable, episodes: Sequence[Episode], config: TrainingConfig, folder: str | Path | None = None,
          progress: ProgressCallback | None = None, processes: Processes | None = None) -> None:  # fmt: skip
    """Train an aligner in place; with a folder, a checkpoint is kept there, from which an interrupted training resumes.

    processes: those that train together; None for this one alone.

    Raises: VisionError without long enough episodes, where the checkpoint has other settings, or the folder cannot be
    made.
    """
    training, shown = AlignerTraining(aligner, with_benches(episodes), config, processes), progress_or_silence(progress)

    def report(row: dict[str, float]) -> None:
        if training.processes.first:
            shown("training", int(row["step"]), config.steps, loss=f"{row['loss']:.4f}")

    if folder is None:
        training.run(report=report)
    else:
        try:
            Path(folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise VisionError(f"the folder {folder} cannot be created: {error.strerror}; give another one.") from error
        if (Path(folder) / CHECKPOINT).is_file():
            training.load(Path(folder) / CHECKPOINT)
        train_in_folder(training, folder, report)
    training.finish()
