"""Training: it learns, goes on where it was to the last bit, and refuses what is not its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.bench import with_benches
from embodiedreamer_gym.vis_aligner.held_out import AFTER_TRUE, CLOSED, evaluate_aligner, tables
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.training import CHECKPOINT, AlignerTraining, TrainingConfig, train
from tests.vis_aligner.scenes import episode

CONFIG = TrainingConfig(steps=8, own_reference_share=0.5)


def fresh(widths: tuple[int, int, int, int] = (8, 8, 8, 16), chunk: int = 4) -> LeanAligner:
    torch.manual_seed(0)
    return LeanAligner(Lean(LeanConfig(widths)), chunk)


def weights(aligner: LeanAligner) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in aligner.network.parameters()])


@pytest.fixture(scope="module")
def learnt() -> LeanAligner:
    """Trained for a few seconds on five episodes of one bench."""
    model = fresh((16, 16, 24, 32))
    train(model, [episode(seed) for seed in range(5)], TrainingConfig(steps=220, learning_rate=3e-3, average=0.98))
    return model


def test_it_learns_a_bench(learnt: LeanAligner) -> None:
    """On an episode it has not seen: better than the last true frame, whole and where things move."""
    found = evaluate_aligner(learnt, episode(9)).measures
    assert found[AFTER_TRUE]["psnr"] > found["copy last"]["psnr"] + 1.5
    assert found[AFTER_TRUE]["psnr.moving"] > found["copy last"]["psnr.moving"] + 3.0
    assert found[CLOSED]["psnr"] > found["copy first"]["psnr"] + 3.0


def test_the_tables_name_every_row(learnt: LeanAligner) -> None:
    text = tables([evaluate_aligner(learnt, episode(seed), chunks=2) for seed in (9, 10)])
    assert all(name in text for name in (AFTER_TRUE, CLOSED, "copy last", "copy first", "raw simulation"))


def test_an_interrupted_training_goes_on_to_the_same_weights(tmp_path) -> None:
    episodes = with_benches([episode(seed) for seed in range(3)])
    whole = fresh()
    train(whole, episodes, CONFIG)
    first = AlignerTraining(fresh(), episodes, CONFIG)
    first.run(3)
    first.save(tmp_path / CHECKPOINT)
    again = fresh()
    train(again, episodes, CONFIG, tmp_path)
    assert torch.equal(weights(again), weights(whole))
    assert not torch.equal(weights(again), weights(fresh()))
    assert sorted(p.name for p in tmp_path.iterdir()) == [CHECKPOINT]


def test_other_episodes_do_not_go_on_where_these_were(tmp_path) -> None:
    first = AlignerTraining(fresh(), [episode(0), episode(1)], CONFIG)
    first.run(3)
    first.save(tmp_path / CHECKPOINT)
    with pytest.raises(VisionError, match="other episodes"):
        train(fresh(), [episode(0)], CONFIG, tmp_path)


def test_a_walk_goes_on_from_own_frames() -> None:
    """Each chunk of a walk follows the last; its references are what the model made, but the anchor, which is true."""
    clip = episode()
    walking = AlignerTraining(fresh(), [clip], TrainingConfig(steps=8, batch=1, own_reference_share=1.0))
    walking.run(1)
    (walk,) = walking.positions
    assert walk is not None
    found, true = walk.references([clip]), clip.references(walk.at)
    assert not np.array_equal(found.last, true.last)
    assert np.array_equal(found.anchor, clip.frames[0])
    assert [w.with_bench for w in walking.positions if w] == [walk.with_bench]
    at = walk.at
    walking.run(2)
    assert walking.positions[0] is None or walking.positions[0].at == at + 4
    never = AlignerTraining(fresh(), [clip], TrainingConfig(steps=8, batch=1, own_reference_share=0.0))
    never.run(3)
    assert never.positions == [None]


@pytest.mark.parametrize("told", [0.0, 1.0])
def test_a_walk_knows_the_backdrop_or_not(told: float) -> None:
    """All along, so that models work for those who have one and for those who have none."""
    clip = with_benches([episode(seed) for seed in range(3)])[0]
    walking = AlignerTraining(
        fresh(), [clip], TrainingConfig(steps=8, batch=1, own_reference_share=1.0, bench_share=told)
    )
    walking.run(1)
    (walk,) = walking.positions
    assert walk is not None and clip.bench is not None
    behind = clip.bench.seen & ~clip.references(walk.at).seen
    assert behind.any() and (walk.references([clip]).seen[behind] == bool(told)).all()


def test_every_frame_is_as_likely_a_start() -> None:
    """Also where episodes differ in length; none starts too late for a chunk."""
    episodes = [episode(0, frames=6), episode(1, frames=17)]
    begin = AlignerTraining(fresh(), episodes, CONFIG).begin
    drawn = [begin(np.random.default_rng(seed)) for seed in range(400)]
    assert {(w.episode, w.at) for w in drawn} == {(0, at) for at in range(2)} | {(1, at) for at in range(13)}


def test_progress_counts_the_steps() -> None:
    seen: list[int] = []
    train(fresh(), [episode()], replace(CONFIG, steps=3), progress=lambda stage, step, of, **more: seen.append(step))
    assert seen == [1, 2, 3]


@pytest.mark.parametrize("damage", ["settings", "widths", "torn", "foreign"])
def test_a_checkpoint_of_something_else_is_refused(damage: str, tmp_path) -> None:
    train(fresh(), [episode()], replace(CONFIG, steps=1), tmp_path)
    path, config, model = tmp_path / CHECKPOINT, replace(CONFIG, steps=1), fresh()
    if damage == "settings":
        config = replace(config, learning_rate=0.5)
    elif damage == "widths":
        model = fresh((8, 16, 16, 16))
    elif damage == "torn":
        path.write_bytes(path.read_bytes()[:1000])
    else:
        path.write_text("shopping list")
    with pytest.raises(VisionError, match=r"checkpoint|settings"):
        train(model, [episode()], config, tmp_path)


def test_episodes_must_be_longer_than_a_chunk() -> None:
    with pytest.raises(VisionError, match="longer than 20 frames"):
        train(fresh(chunk=20), [episode()], CONFIG)


def test_a_folder_that_cannot_be_made_is_said(tmp_path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(VisionError, match="cannot be created"):
        train(fresh(), [episode()], CONFIG, tmp_path / "file" / "model")
