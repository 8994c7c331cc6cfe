"""The benchmark of formats: the same numbers come back from each, without its verdicts and without LeRobot."""

from __future__ import annotations

from pathlib import Path

import pytest

for module in ("pyarrow", "rosbags", "mcap"):
    pytest.importorskip(module, reason="the benchmark writes every format")

from benchmarks import logs  # noqa: E402


def test_every_format_gives_the_same_numbers(tmp_path: Path) -> None:
    model, motions = logs.make_ticks()
    formats = logs.write_all(tmp_path, model, motions[:1], None)
    truth = logs.load(model, formats["csv"])
    assert list(formats) == ["csv", "hdf5", "mcap", "rosbag2", "rosbag2_mcap", "LeRobot set, rad"]
    for name, given in formats.items():
        found = logs.largest(logs.load(model, given), truth)
        assert max(found.values()) <= (logs.FLOAT32 if name.startswith("LeRobot") else 0.0), name
        assert name == "csv" or truth[0].position.std() > 0.1
