"""One clip against the truth, beside its baselines."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import BASELINES, GroundTruth, Measures, evaluate, evaluate_all, psnr
from embodiedreamer_gym.vis_aligner.metrics.evaluate import OF_MANY, UNITS

NAMES = ("background", "table", "robot", "cup", "mat")


@pytest.fixture(scope="module")
def truth(bench) -> GroundTruth:
    return bench.truth


@pytest.fixture(scope="module")
def rows(bench, truth: GroundTruth) -> dict[str, Measures]:
    return evaluate_all({"noise-free": bench.clean[1:], "true": bench.frames[1:]}, truth, bench.simulated[1:], chunk=4)


def test_the_baselines_come_first_and_always(rows: dict[str, Measures]) -> None:
    assert list(rows) == [*BASELINES, "noise-free", "true"]
    worst_to_best = [rows[name]["psnr.moving"] for name in ("copy first", "copy last", "noise-free", "true")]
    assert worst_to_best == sorted(worst_to_best) and worst_to_best[-1] == 100.0


def test_values_are_those_of_the_measures(bench, truth: GroundTruth, rows: dict[str, Measures]) -> None:
    found = rows["noise-free"]
    assert found["psnr.cup"] == psnr(bench.clean[1:], truth.frames, truth.classes == 3)
    assert found["psnr.objects"] == psnr(bench.clean[1:], truth.frames, truth.classes >= 3)
    assert found["psnr.arm and objects"] == psnr(bench.clean[1:], truth.frames, truth.classes >= 2)
    assert found["psnr"] == pytest.approx(20 * np.log10(255 / 2.02), abs=0.2)  # the noise's own
    assert found["iou.objects"] == pytest.approx((found["iou.cup"] + found["iou.mat"]) / 2)
    assert found["colour_shift"] < 0.1


def test_the_ceiling_is_what_true_frames_reach(rows: dict[str, Measures]) -> None:
    for name in ("robot", "cup", "mat", "objects"):
        assert rows["true"][f"iou.{name}"] == rows["copy first"][f"iou_ceiling.{name}"] > 0.9
    assert rows["copy first"]["iou.cup"] < 0.4


def test_colour_shift_is_of_the_still_background_alone(bench, truth: GroundTruth) -> None:
    tinted = bench.frames[1:].copy()
    tinted[truth.classes >= 2] = 255
    assert evaluate(tinted, truth)["colour_shift"] == 0.0
    tinted = np.clip(bench.frames[1:] + np.array((0, -3, 0)), 0, 255).astype(np.uint8)
    found = evaluate(tinted, truth)
    assert found["colour_shift"] == pytest.approx(3, abs=0.02) and found["colour_shift_rgb.g"] < 0


def test_drift_has_a_number_for_each_chunk(bench, truth: GroundTruth, rows: dict[str, Measures]) -> None:
    for name in ("psnr", "ssim", "psnr.moving", "psnr.cup", "iou.objects", "colour_shift"):
        assert len(rows["copy last"].drift[name]) == 4
    worse = bench.frames[1:].copy()
    for k in range(4):
        worse[4 * k : 4 * k + 4] = np.clip(worse[4 * k : 4 * k + 4].astype(int) + 4 * k, 0, 255)
    curves = evaluate(worse, truth, chunk=4).drift
    assert list(curves["psnr"]) == sorted(curves["psnr"], reverse=True) and curves["psnr"][0] == 100.0
    assert curves["colour_shift"] == pytest.approx([0, 4, 8, 12], abs=0.2)
    assert rows["copy first"].drift["iou.cup"][-1] < 0.1 < 0.5 < rows["copy first"].drift["iou.cup"][0]


def test_what_cannot_be_measured_is_none_with_a_reason(bench) -> None:
    classes = np.where(bench.classes == 4, 1, bench.classes).astype(np.uint8)
    truth = GroundTruth(bench.frames[1:2], classes[1:2], bench.frames[0], classes[0], NAMES)
    found = evaluate(bench.clean[1:2], truth)
    for name in ("psnr.mat", "iou.mat", "iou_ceiling.mat", "temporal_error", "lpips"):
        assert found[name] is None and found.reasons[name]
    assert "not shipped" in found.reasons["lpips"] and "i3d_torchscript.pt" in found.reasons["fvd"]
    assert set(found.reasons) == {k for k, v in found.values.items() if v is None} | {"rfvd", "fvd"}


def test_regions_that_are_empty_have_no_value_either(bench) -> None:
    frame, classes = bench.frames[1:2], bench.classes[1:2]
    covered = np.full_like(classes[0], 2)  # nothing of the reference is background
    found = evaluate(bench.clean[1:2], GroundTruth(frame, classes, bench.frames[0], covered, NAMES))
    assert found["colour_shift"] is None and found.reasons["colour_shift_rgb.g"] == "no background stands still"
    assert found.drift.get("colour_shift") is None
    still = evaluate(bench.clean[1:2], GroundTruth(frame, classes, frame[0], classes[0], NAMES))
    assert still["psnr.moving"] is None and still.reasons["psnr.moving"] == "nothing moves"


def test_the_result_is_json_with_units(rows: dict[str, Measures]) -> None:
    said = json.loads(json.dumps(rows["raw simulation"].as_dict(), allow_nan=False))
    assert said["frames"] == 16 and said["size"] == [96, 72] and said["units"]["psnr.cup"] == "dB"
    assert set(said["units"].values()) <= set(UNITS.values()) and set(said["units"]) == set(said["values"])
    assert said["drift"]["psnr"] and said["reasons"]["fvd"]


def test_the_same_again_is_the_same(bench, rows: dict[str, Measures]) -> None:
    again = evaluate(bench.clean[1:], bench.truth, chunk=4)
    assert again.as_dict() == rows["noise-free"].as_dict()


def test_a_network_is_used_and_kept_for_the_truth(bench, truth: GroundTruth) -> None:
    class Network:
        path, calls = "stub", 0

        def features(self, frames: np.ndarray) -> np.ndarray:
            self.calls += 1
            return frames.reshape(len(frames), -1)[:, :5].astype(float)

        def distances(self, generated: np.ndarray, true: np.ndarray) -> np.ndarray:
            return np.full(len(true), 0.25)

    network = Network()
    rows = evaluate_all({"a": bench.clean[1:]}, truth, bench.simulated[1:], 8, network, network)
    assert network.calls == 5  # four clips and the truth, once
    assert rows["a"]["lpips"] == 0.25 and rows["a"].features["fvd"].truth.shape == (16, 5)
    assert rows["a"].reasons["fvd"] == rows["a"].reasons["rfvd"] == OF_MANY and "lpips" not in rows["a"].reasons


def test_what_does_not_fit_is_refused(bench, truth: GroundTruth, rows: dict[str, Measures]) -> None:
    with pytest.raises(VisionError, match="generated frames are 15 x 96x72, the true ones 16 x 96x72"):
        evaluate(bench.clean[2:], truth)
    with pytest.raises(VisionError, match="a baseline's name"):
        evaluate_all({"copy last": bench.clean[1:]}, truth, bench.simulated[1:])
    with pytest.raises(VisionError, match=r"class 4 is in the pictures, but there are names for 0 \.\. 3"):
        replace(truth, class_names=truth.class_names[:4])
    with pytest.raises(VisionError, match="classes of the reference are 1 x 48x72"):
        replace(truth, reference_classes=truth.reference_classes[:, ::2])
    with pytest.raises(VisionError, match=r"no measure 'fid'; give one of psnr, ssim"):
        rows["copy last"]["fid"]
    with pytest.raises(VisionError, match="chunks of 0"):
        evaluate(bench.clean[1:], truth, chunk=0)
    assert repr(truth) == "GroundTruth(16 x 96x72, robot, cup, mat)" and repr(rows["true"]).startswith(
        "Measures(16 x 96x72"
    )
