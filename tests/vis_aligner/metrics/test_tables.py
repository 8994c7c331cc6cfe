"""Tables fit a terminal and say what they leave out."""

from __future__ import annotations

import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.tables import WIDTH
from embodiedreamer_gym.vis_aligner.metrics import drift_table, evaluate_all, summarise, table
from embodiedreamer_gym.vis_aligner.metrics.summary import Figure, Summary
from embodiedreamer_gym.vis_aligner.metrics.tables import COLUMNS


@pytest.fixture(scope="module")
def rows(bench) -> dict[str, Summary]:
    both = [evaluate_all({"noise-free": bench.clean[1:]}, bench.truth, bench.simulated[1:], 2) for _ in range(2)]
    return {name: summarise([one[name] for one in both]) for name in both[0]}


def full(spread: float = 10.1) -> Summary:
    figures = {name: Figure(98.765, spread, 10) for name in COLUMNS if name not in ("rfvd", "fvd")}
    return Summary(10, figures, 8, {}, {"rfvd": 12345.6, "fvd": 1234.5}, {}, ())


def test_a_table_has_a_row_each_and_says_what_is_absent(rows: dict[str, Summary]) -> None:
    text = table(rows)
    lines = text.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert [line.split("  ")[0] for line in lines[1:5]] == ["raw simulation", "copy first", "copy last", "noise-free"]
    assert "LPIPS" not in lines[0] and "LPIPS: none; LPIPS needs weights" in text and "FVD: none" in text
    assert "mean ± sd over episodes: 2" in text and "obj IoU of the true frames themselves: 1.00" in text
    assert "rfvd from 4 clips in 64 dimensions" in text
    assert f"{rows['noise-free']['psnr']:.2f}±0.0" in lines[4]


def test_a_single_episode_has_no_spread(bench) -> None:
    text = table(evaluate_all({}, bench.truth, bench.simulated[1:]))
    assert "±" not in text and "copy last" in text
    assert "rfvd: none; a Frechet distance needs the clips of several episodes" in text


def test_a_wide_table_drops_the_spread_and_wraps_names() -> None:
    text = table({"a very long name of a model that was fine-tuned in a lab": full(), "b": full()})
    assert max(map(len, text.splitlines())) <= WIDTH and "±" not in text
    assert "mean over episodes: 10" in text and "98.7650" in text
    assert all(word in text for word in ("very", "long", "model", "fine-tuned", "lab"))


def test_markdown_has_as_many_cells_in_each_line(rows: dict[str, Summary]) -> None:
    body, notes = table(rows, markdown=True).split("\n\n")
    assert {line.count("|") for line in body.splitlines()} == {body.splitlines()[0].count("|")}
    assert body.splitlines()[1].startswith("| --- | ---: |") and notes.startswith("- mean ± sd")


def test_columns_can_be_chosen_also_by_class(rows: dict[str, Summary]) -> None:
    head = table(rows, ["iou.cup", "psnr.cup", "gradient_psnr"]).splitlines()[0]
    assert head.split() == ["iou.cup", "psnr.cup", "gradient", "dB"]
    with pytest.raises(VisionError, match=r"columns \['fid'\] are not measures; choose from psnr, "):
        table(rows, ["psnr", "fid"])
    with pytest.raises(VisionError, match="no row"):
        table({})


def test_drift_shows_the_first_and_the_last_chunk(rows: dict[str, Summary]) -> None:
    head, *lines = drift_table(rows).splitlines()
    assert head.split() == ["PSNR", "dB,", "chunk", *map(str, range(1, 9))] and len(lines) == 4
    long = Summary(1, {}, 8, {"ssim": tuple(k / 100 for k in range(40))}, {}, {}, ())
    points = drift_table({"long": long}, "ssim").splitlines()
    assert points[0].split()[2:] == ["1", "5", "10", "14", "18", "23", "27", "31", "36", "40"]
    assert points[1].split()[1] == "0.000" and points[1].split()[-1] == "0.390"
    assert drift_table({"long": long}, "ssim", markdown=True).startswith("| SSIM, chunk | 1 |")
    with pytest.raises(VisionError, match="no row has a drift of 'lpips'; there are ssim"):
        drift_table({"long": long}, "lpips")
