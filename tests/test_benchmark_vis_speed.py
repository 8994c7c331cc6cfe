"""The command that times full-size networks on a GPU, at a tiny size on the CPU."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("diffusers", reason="the extra [svd] is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")


@pytest.mark.release
def test_the_command_for_a_gpu_runs(monkeypatch, capsys) -> None:
    from benchmarks import vis_speed

    for name, few in (("REPEATS", 1), ("REPEATS_SVD", 1), ("SVD_STEPS", 2), ("MIDDLE", 20)):
        monkeypatch.setattr(vis_speed, name, few)
    vis_speed.on_device("cpu", tiny=True, size=(64, 48), frames=4)
    out = capsys.readouterr().out
    seconds = [float(x) for x in re.findall(r"at once: ([0-9.]+) s, of which [0-9.]+ s on the processor", out)]
    assert len(seconds) == 2 and 0 < seconds[0] < seconds[1] + 0.5
    assert len(re.findall(r"at once: [0-9]+ frames/s", out)) == 3
