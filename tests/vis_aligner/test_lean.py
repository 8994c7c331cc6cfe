"""The lean network: sizes, gate, batches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.aligner import generate
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.motion_window import moving, windows
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs, reprojected_pixels, to_frames
from tests.vis_aligner.scenes import episode

SMALL = LeanConfig((8, 8, 8, 16))


def aligner(config: LeanConfig = SMALL, bias: float = 0.0, choice: float = -50.0, **options) -> LeanAligner:
    """Untrained, but with weights in its last layer; bias: of the gate; choice: of plate and anchor, not the last frame."""
    torch.manual_seed(0)
    network = Lean(config)
    torch.nn.init.normal_(network.out.weight, std=0.1)
    with torch.no_grad():
        network.out.bias[12:16] = bias
        network.out.bias[16:24] = choice
        network.out.bias[24:] = -50.0
    return LeanAligner(network, **options)


def test_the_default_is_small_enough_for_the_wheel() -> None:
    assert 2 * sum(p.numel() for p in Lean().parameters()) < 5e6  # bytes, in half precision


@pytest.mark.parametrize("size", [(48, 64), (96, 128), (50, 66), (240, 320)])
@pytest.mark.parametrize("frames", [1, 3])
def test_any_size_and_length(size: tuple[int, int], frames: int) -> None:
    network, inputs = Lean(SMALL), SMALL.inputs
    picture = torch.zeros(1, frames, 3, *size)
    made = network(picture, torch.ones(1), torch.zeros(1, frames, inputs.per_frame, *size),
                   torch.zeros(1, inputs.per_clip, *size), picture, torch.zeros(1, frames, inputs.sources, 3, *size),
                   picture[:, :, :1])  # fmt: skip
    assert made.shape == picture.shape


def test_a_shut_gate_leaves_pixels_exactly_as_they_were() -> None:
    one = episode()
    references, condition = one.references(0), one.condition.part(8, 9)
    found = reprojected_pixels(references, condition, Inputs())
    still = to_frames(found.still)[0]
    shut, opened, whole = (
        aligner(replace(SMALL, gate=gate), bias=bias).render([references], [condition])[0][0]
        for gate, bias in ((True, -50.0), (True, 50.0), (False, -50.0))
    )
    kept = found.stale[0, 0].numpy() == 0
    assert np.array_equal(shut[kept], still[kept]) and 0.5 < kept.mean() < 1
    assert 0.1 < (opened != still).any(axis=2).mean() < (whole != still).any(axis=2).mean()


def test_what_true_pictures_tell_can_be_chosen() -> None:
    """Where the arm has come back to where it was in the first frame, that is shown, whatever was made since."""
    one = episode()
    references, condition = replace(one.references(8), last=np.zeros_like(one.frames[0])), one.condition.part(0, 1)
    made = aligner(bias=-50.0, choice=50.0).render([references], [condition])[0][0]
    rows, columns = windows([references], [condition])[0]
    found = reprojected_pixels(references, condition, Inputs())
    old = found.stale[0, 0].numpy() > 0
    assert np.array_equal(made[rows, columns][~old[rows, columns]], one.frames[0][rows, columns][~old[rows, columns]])
    plate, anchor, gallery = to_frames(found.sources)[0]
    free = (condition.classes[0] < 2) & references.seen
    assert np.array_equal(plate[free], references.plate[free]) and not plate[(condition.classes[0] == 2) & ~free].any()
    assert np.array_equal(anchor, one.frames[0]) and np.array_equal(gallery, to_frames(found.still)[0])  # there is none
    least = replace(Inputs(), anchor=False, plate=False, gallery=False)
    assert reprojected_pixels(references, condition, least).sources.shape[1] == 0


def test_only_what_moves_is_drawn() -> None:
    """Beyond the window around it, whatever the network wants, and everywhere where nothing moves."""
    one, model = episode(), aligner(bias=50.0)
    still = Condition(
        *(np.repeat(x[:1], 4, 0) for x in (one.condition.rgb, one.condition.classes, one.condition.depth))
    )
    assert (model.render([one.references(0)], [still])[0] == one.frames[0]).all()
    references, condition = one.references(0), one.condition.part(1, 3)
    rows, columns = windows([references], [condition])[0]
    moved = moving(references, condition)
    outside = np.ones(moved.shape, bool)
    outside[rows, columns] = False
    assert moved.any() and not (moved & outside).any() and outside.any()
    made = model.render([references], [condition])[0]
    assert np.array_equal(made[:, outside], np.repeat(one.frames[:1], 2, 0)[:, outside])


@pytest.mark.parametrize("seed", range(5))
def test_windows_of_a_batch_have_one_size(seed: int) -> None:
    """And each lies in the picture, around what moves in its own clip."""
    rng = np.random.default_rng(seed)
    ones = [episode(int(k)) for k in rng.integers(50, size=3)]
    starts = rng.integers(14, size=3)
    references = [e.references(int(s)) for e, s in zip(ones, starts, strict=True)]
    conditions = [e.condition.part(int(s), int(s) + 3) for e, s in zip(ones, starts, strict=True)]
    places = windows(references, conditions)
    assert len({(r.stop - r.start, c.stop - c.start) for r, c in places}) == 1
    for (rows, columns), reference, condition in zip(places, references, conditions, strict=True):
        inside = np.zeros((48, 64), bool)
        inside[rows, columns] = True
        assert (
            rows.start >= 0
            and columns.start >= 0
            and inside.sum() == (rows.stop - rows.start) * (columns.stop - columns.start)
        )
        assert not (moving(reference, condition) & ~inside).any()


@pytest.mark.parametrize("inputs", [Inputs(), Inputs(*[False] * 7)], ids=["all", "least"])
def test_a_batch_gives_what_each_alone_gives(inputs: Inputs) -> None:
    ones = [episode(seed) for seed in range(3)]
    model = aligner(replace(SMALL, inputs=inputs), steps=2)
    references, conditions = [e.references(0) for e in ones], [e.condition.part(1, 9) for e in ones]
    together = model.render(references, conditions)
    for k in range(3):
        alone = model.render(references[k : k + 1], conditions[k : k + 1])[0]
        assert np.abs(together[k].astype(int) - alone).max() <= 1
    assert np.array_equal(model.render(references, conditions)[0], together[0])


def test_dreaming_goes_chunk_by_chunk() -> None:
    one, model = episode(), aligner(bias=50.0, chunk=5)
    frames, references = generate(model, [one.references(0)], [one.condition.part(1, 17)])
    first = model.render([one.references(0)], [one.condition.part(1, 6)])[0]
    after = one.references(0).after(first, one.condition.part(1, 6))
    second = model.render([after], [one.condition.part(6, 11)])[0]
    assert len(frames[0]) == 16
    assert np.array_equal(frames[0][:10], np.concatenate([first, second]))
    assert np.array_equal(references[0].last, frames[0][-1])


def test_clips_that_do_not_belong_together_are_refused() -> None:
    one, model = episode(), aligner()
    small = Condition(*(x[:, ::2, ::2] for x in (one.condition.rgb, one.condition.classes, one.condition.depth)))
    with pytest.raises(VisionError, match=r"\(32, 24\), \(64, 48\)"):
        model.render([one.references(0)], [small])
    with pytest.raises(VisionError, match="1 references, 2 clips"):
        model.render([one.references(0)], [one.condition, one.condition])
