"""Evaluates an aligner on held-out episodes, after true references and in closed loop, beside baselines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import metrics
from embodiedreamer_gym.vis_aligner.aligner import Aligner, generate
from embodiedreamer_gym.vis_aligner.clip import Bench, Episode

MARK = (255, 0, 255)  # RGB
MOST_NAMED = 12  # episodes listed by name
AFTER_TRUE, CLOSED, CLEAN = "after true frames", "closed loop", "without noise"


@dataclass(frozen=True, eq=False)
class HeldOutResult:
    """Clips and measures of one episode, by name.

    clips: each (T, H, W, 3) uint8; the reference is not among the T frames; unclassed (T, H, W) bool: pixels of the
    true frames that show something moving that is neither robot nor object.
    """

    episode: Episode
    clips: Mapping[str, np.ndarray]
    measures: Mapping[str, metrics.Measures]
    unclassed: np.ndarray

    @property
    def unclassed_share(self) -> float:
        """Share of pixels that show something moving that is neither robot nor object; no model can predict it."""
        return float(self.unclassed.mean())

    def marked(self) -> np.ndarray:
        """The true frames (T, H, W, 3) with the unclassed pixels in one colour."""
        return np.where(self.unclassed[..., None], np.array(MARK, np.uint8), self.clips["real"])


def evaluate_aligner(
    aligner: Aligner, episode: Episode, chunks: int | None = None, bench: Bench | None = None
) -> HeldOutResult:
    """Evaluate the first chunks of an episode (default: all whole ones), after true frames and in closed loop.

    In closed loop, the references are the aligner's own frames. bench: what is known beforehand, as in a bank.

    Raises: VisionError when the episode is not longer than a chunk.
    """
    k = aligner.chunk
    most = (len(episode) - 1) // k
    if most < 1:
        raise VisionError(
            f"{episode.name} has {len(episode)} frames; at least {k + 1} are needed (a reference and one chunk)."
        )
    count = k * (most if chunks is None else min(chunks, most))
    episode = episode.lit(bench)
    part = episode.condition.part
    after = [aligner.render([episode.references(s, bench)], [part(s + 1, s + 1 + k)])[0] for s in range(0, count, k)]
    closed, _ = generate(aligner, [episode.references(0, bench)], [part(1, count + 1)])
    clips = {AFTER_TRUE: np.concatenate(after), CLOSED: closed[0]}
    if episode.clean is not None:
        clips[CLEAN] = episode.clean[1 : count + 1]
    classes = episode.condition.classes
    truth = metrics.GroundTruth(
        episode.frames[1 : count + 1], classes[1 : count + 1], episode.frames[0], classes[0], episode.class_names
    )
    simulated = episode.condition.rgb[1 : count + 1]
    measures = metrics.evaluate_all(clips, truth, simulated, chunk=k)
    unclassed = metrics.unclassed_region(episode.frames, classes)[1 : count + 1]
    return HeldOutResult(episode, {"simulated": simulated, **clips, "real": truth.frames}, measures, unclassed)


def tables(results: Sequence[HeldOutResult], markdown: bool = False) -> str:
    """Tables of the measures over episodes, mean and spread, and of the drift from chunk to chunk."""
    rows = {name: metrics.summarise([j.measures[name] for j in results]) for name in results[0].measures}
    drifting = {name: row for name, row in rows.items() if name in (AFTER_TRUE, CLOSED, "copy last")}
    shares = ", ".join(f"{j.episode.name} {j.unclassed_share:.1%}" for j in results[:MOST_NAMED])
    unclassed = (
        "share of pixels that show something moving that is neither robot nor object: "
        f"{shares}{', ...' * (len(results) > MOST_NAMED)}"
    )
    return (
        f"{metrics.table(rows, markdown=markdown)}\n\n{metrics.drift_table(drifting, markdown=markdown)}\n\n{unclassed}"
    )
