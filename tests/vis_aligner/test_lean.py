"""The lean network: sizes, gate, batches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.aligner import dream
from embodiedreamer_gym.vis_aligner.channels import Inputs
from embodiedreamer_gym.vis_aligner.clip import Condition
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from tests.vis_aligner.scenes import episode

SMALL = LeanConfig((8, 8, 16), 4)


def aligner(config: LeanConfig = SMALL, bias: float = 0.0, **options) -> LeanAligner:
    """Untrained, but with weights in its last layer; bias: of the gate."""
    torch.manual_seed(0)
    network = Lean(config)
    torch.nn.init.normal_(network.out.weight, std=0.1)
    with torch.no_grad():
        network.out.bias[3] = bias
    return LeanAligner(network, **options)


def test_the_default_is_small_enough_for_the_wheel() -> None:
    assert 2 * sum(p.numel() for p in Lean().parameters()) < 5e6  # bytes, in half precision


@pytest.mark.parametrize("size", [(48, 64), (96, 128), (50, 66), (240, 320)])
@pytest.mark.parametrize("frames", [1, 3])
def test_any_size_and_length(size: tuple[int, int], frames: int) -> None:
    network, inputs = Lean(SMALL), SMALL.inputs
    picture = torch.zeros(1, frames, 3, *size)
    made = network(picture, torch.ones(1), torch.zeros(1, frames, inputs.per_frame, *size),
                   torch.zeros(1, inputs.per_clip, *size), picture)  # fmt: skip
    assert made.shape == picture.shape


def test_a_shut_gate_leaves_pixels_exactly_as_they_were() -> None:
    one = episode()
    shut = aligner(bias=-50.0).render([one.references(0)], [one.condition.part(0, 1)])[0]
    assert np.array_equal(shut[0], one.frames[0])
    opened = aligner(bias=50.0).render([one.references(0)], [one.condition.part(0, 1)])[0]
    assert (opened[0] != one.frames[0]).mean() > 0.5
    redrawn = aligner(replace(SMALL, gate=False), bias=-50.0).render([one.references(0)], [one.condition.part(0, 1)])[0]
    assert (redrawn[0] != one.frames[0]).mean() > 0.5


@pytest.mark.parametrize("inputs", [Inputs(), Inputs(False, False, False, False, False)], ids=["all", "least"])
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
    frames, references = dream(model, [one.references(0)], [one.condition.part(1, 17)])
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
