"""What a calibration says of itself."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.vis_aligner import camera_calibration
from embodiedreamer_gym.vis_aligner.camera_calibration import CameraFit, Keypoints, StationFit
from tests.vis_aligner.camera_calibration.conftest import TRUTH


def fit(*scores: float | None, **fields: object) -> CameraFit:
    stations = tuple(
        StationFit(TRUTH.with_(name=f"c/{k}"), 24, 0.5, 0.9, score, 0.6, None, 0.002, 0.001, 0.1)
        for k, score in enumerate(scores)
    )
    return CameraFit(stations, ("focal",), sd={"focal": 1.25}, **fields)  # pyright: ignore[reportArgumentType]


def test_a_stand_that_fits_far_worse_than_the_best_is_doubtful() -> None:
    assert fit(0.8, 0.7, 0.3).doubtful == ("c/2",)
    assert fit(0.4, 0.31).doubtful == ()
    assert fit(None).doubtful == ()
    assert "doubtful, look at the overlay: c/2" in str(fit(0.8, 0.7, 0.3))


def test_one_stand_alone_can_be_doubtful() -> None:
    assert fit(0.25).doubtful == ("c/0",)


def test_the_table_has_a_line_for_each_stand() -> None:
    lines = str(fit(0.8, 0.7, k1=-0.1)).splitlines()
    assert lines[0] == "lens at 240 x 180: fx 205.0, fy 205.0, cx 119.5, cy 89.5, k1 -0.100 px (fitted: focal ± 1.2)"
    assert lines[2].split() == ["camera", "frames", "position", "m", "±", "mm", "outline", "px", "found", "score",
                                "overlap", "marks", "px", "±", "px"]  # fmt: skip
    assert lines[3].split() == ["c/0", "24", "+1.250", "+0.950", "+1.450", "2.0", "0.50", "90%", "0.80", "0.60", "0.10"]
    assert len({len(line.rstrip()) for line in lines[3:]}) == 1 and len(lines) == 5


def test_it_is_json() -> None:
    data = json.loads(json.dumps(fit(0.8, delay=0.4).as_dict()))
    assert data["delay"] == 0.4 and data["sd"] == {"focal": 1.25} and data["doubtful"] == []
    assert data["stands"][0]["camera"]["fx"] == 205.0 and data["stands"][0]["picture_sd"] == 0.1


def test_a_pinhole_leaves_frames_alone() -> None:
    frame = np.random.default_rng(0).integers(0, 255, (180, 240, 3)).astype(np.uint8)
    assert fit(0.8).undistorted(frame) is frame


def test_distortion_is_taken_off() -> None:
    """A point seen at a bent place is seen where the pinhole camera has it once the frame is straightened."""
    bent = fit(0.8, k1=-0.2)
    point = np.array([[0.4, 0.75, 0.95]])
    (x, y, _), (u, v, _) = bent.views()[0].project(point)[0], fit(0.8).views()[0].project(point)[0]
    assert np.hypot(x - u, y - v) > 2.0
    frame = np.zeros((180, 240, 3), np.uint8)
    frame[round(y) - 1 : round(y) + 2, round(x) - 1 : round(x) + 2] = 255
    rows, jacobian_columns = np.nonzero(bent.undistorted(frame)[..., 0] > 100)
    assert (jacobian_columns.mean(), rows.mean()) == (pytest.approx(u, abs=0.8), pytest.approx(v, abs=0.8))


def test_former_names_work_with_a_warning() -> None:
    with pytest.warns(DeprecationWarning, match="StandFit is now StationFit"):
        assert camera_calibration.StandFit is StationFit
    with pytest.warns(DeprecationWarning, match=r"CameraFit\.stands is now CameraFit\.stations"):
        assert CameraFit((), ()).stands == ()
    with pytest.warns(DeprecationWarning, match="'stand' of Keypoints is now 'station'"):
        marks = Keypoints(stand=np.zeros(1), point=np.zeros((1, 3)), pixel=np.zeros((1, 2)), sd=np.ones(1))
    assert len(marks) == 1
