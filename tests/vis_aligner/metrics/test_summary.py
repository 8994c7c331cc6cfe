"""Many episodes in one: mean, spread, count, and the distances over all clips."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import Measures, frechet_distance, summarise
from embodiedreamer_gym.vis_aligner.metrics.evaluate import Features


def measures(value: float | None, curve: tuple, clips: int, seed: int = 0) -> Measures:
    rng = np.random.default_rng(seed)
    features = Features(rng.normal(1, 1, (clips, 3)), rng.normal(0, 1, (clips, 3)))
    reasons = {"fvd": "no network", **({} if value is not None else {"psnr.pen": "no pen"})}
    return Measures(
        16, (96, 72), {"psnr": 30.0 + seed, "psnr.pen": value}, 8, {"psnr": curve}, reasons, {"rfvd": features}
    )


def test_mean_spread_and_count() -> None:
    found = summarise([measures(20.0, (1.0,), 2), measures(None, (3.0, 5.0), 2, 1), measures(26.0, (5.0, None), 2, 2)])
    assert found.episodes == 3 and found["psnr"] == 31.0 and found.figures["psnr"].sd == pytest.approx(1.0)
    pen = found.figures["psnr.pen"]
    assert (pen.mean, pen.count) == (23.0, 2) and pen.sd == pytest.approx(np.sqrt(18.0))
    assert found.drift["psnr"] == (3.0, 5.0)
    assert "psnr.pen" not in found.reasons


def test_distances_are_over_the_clips_of_all_episodes() -> None:
    episodes = [measures(1.0, (1.0,), 3, seed) for seed in range(2)]
    parts = [np.concatenate([getattr(m.features["rfvd"], p) for m in episodes]) for p in ("generated", "truth")]
    found = summarise(episodes)
    assert found["rfvd"] == frechet_distance(*parts) and found.warnings == ()
    assert found["fvd"] is None and found.reasons["fvd"] == "no network"


def test_fewer_clips_than_dimensions_are_warned_of_and_one_is_too_few() -> None:
    found = summarise([measures(1.0, (1.0,), 3)])
    assert found["rfvd"] is not None and "3 clips in 3 dimensions" in found.warnings[0]
    assert found.figures["psnr"].sd is None
    alone = summarise([measures(1.0, (1.0,), 1)])
    assert alone["rfvd"] is None and "1 clips of 8 frames" in alone.reasons["rfvd"]


def test_no_episode_has_it() -> None:
    found = summarise([measures(None, (1.0,), 2), measures(None, (1.0,), 2)])
    assert found["psnr.pen"] is None and found.figures["psnr.pen"] is None and found.reasons["psnr.pen"] == "no pen"


def test_the_summary_is_json_with_units() -> None:
    said = json.loads(
        json.dumps(summarise([measures(None, (1.0,), 4), measures(2.0, (None,), 4)]).as_dict(), allow_nan=False)
    )
    assert said["figures"]["psnr"] == {"mean": 30.0, "sd": 0.0, "count": 2, "unit": "dB"}
    assert said["distances"]["fvd"] == {"value": None, "unit": "1"} and said["drift"]["psnr"] == [1.0]


def test_what_does_not_fit_is_refused() -> None:
    one = measures(1.0, (1.0,), 2)
    with pytest.raises(VisionError, match="0 episodes"):
        summarise([])
    with pytest.raises(VisionError, match=r"chunks \[4, 8\]"):
        summarise([one, replace(one, chunk=4)])
    with pytest.raises(VisionError, match=r"no measure 'ssim'; give one of psnr, psnr\.pen, rfvd, fvd"):
        summarise([one])["ssim"]
