"""A lens bends light and classes alike, and a sensor makes of light what one asks of it."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.standin.film.camera_noise import (
    FINER,
    NOISE,
    CameraNoise,
    NoisyCamera,
    add_sensor_noise,
    auto_exposure,
    to_uint8,
    tone_map,
)
from embodiedreamer_gym.standin.film.play import EpisodePlayer
from tests.standin.film.grey import overlap

HEAD = CAMERAS["head"]
BARREL = CameraNoise(barrel=-0.03)
SIZES = [(128, 96), (200, 160), (320, 240)]


def coordinates(optics: NoisyCamera) -> np.ndarray:
    """A picture (H', W', 3) of the wide pinhole whose light is where it comes from: column, row, of the wide picture."""
    width, height = optics.wide.size
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return np.dstack([u, v, np.ones_like(u)])


def test_without_distortion_the_picture_is_the_pinholes() -> None:
    optics = NoisyCamera(HEAD, (128, 96), CameraNoise())
    x, y = optics.margin
    picture = coordinates(optics)
    np.testing.assert_allclose(optics.distort(picture), picture[y : y + 96, x : x + 128], atol=1e-3)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("barrel", [-0.03, 0.02])
def test_each_pixel_shows_the_direction_that_the_lens_sends_there(size, barrel: float) -> None:
    optics = NoisyCamera(HEAD, size, CameraNoise(barrel=barrel))
    seen = optics.distort(coordinates(optics))
    wide, own = optics.wide.matrix(), HEAD.matrix(size)
    x, y = (seen[..., 0] - wide[0, 2]) / wide[0, 0], (seen[..., 1] - wide[1, 2]) / wide[1, 1]
    share = 1.0 + barrel * (x**2 + y**2)
    u, v = own[0, 0] * x * share + own[0, 2], own[1, 1] * y * share + own[1, 2]
    there = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    np.testing.assert_allclose((u, v), there, atol=0.07)  # OpenCV interpolates at 32nds of a pixel


def test_a_barrel_shows_more_than_the_pinhole_and_the_margin_holds_it() -> None:
    optics = NoisyCamera(HEAD, (128, 96), BARREL)
    seen = optics.distort(coordinates(optics))
    (x, y), (width, height) = optics.margin, optics.wide.size
    assert seen[0, 0, 0] < x - 1 and seen[0, 0, 1] < y - 1
    assert seen[..., 0].min() > 1.0 and seen[..., 0].max() < width - 2
    assert seen[..., 1].min() > 1.0 and seen[..., 1].max() < height - 2
    assert seen[..., 2].min() > 0.99  # nothing came from beyond the margin


def test_the_wide_camera_sees_what_the_camera_sees_in_its_middle(stage: EpisodePlayer) -> None:
    optics = NoisyCamera(HEAD, (128, 96), BARREL)
    stage.env.reset(seed=0)
    x, y = optics.margin
    wide, own = stage.capture(optics.wide, optics.wide.size), stage.capture(HEAD, (128, 96))
    same = wide.segmentation[y : y + 96, x : x + 128] == own.segmentation
    assert same.mean() > 0.998


@pytest.mark.parametrize("size", SIZES)
def test_masks_fit_the_bent_picture(stage: EpisodePlayer, size: tuple[int, int]) -> None:
    """Against the bent picture of a mask, where more than half a pixel's light comes from it; worse when not bent."""
    optics = NoisyCamera(HEAD, size, BARREL)
    stage.env.reset(seed=3)
    width, height = optics.wide.size
    fine = stage.capture(optics.wide, (FINER * width, FINER * height)).segmentation
    masks = optics.distort_classes(fine)
    straight = stage.capture(HEAD, size).segmentation
    assert masks.shape == straight.shape and masks.dtype == np.uint8
    once = stage.capture(optics.wide, optics.wide.size).segmentation
    for number in range(1, 5):
        light = optics.distort(np.repeat((once == number)[..., None], 3, axis=2))[..., 0]
        assert overlap(light > 0.5, masks == number) > (0.95 if number < 3 else 0.8)
    moved = [(np.argwhere(masks == n).mean(axis=0) - np.argwhere(straight == n).mean(axis=0)) for n in (1, 4)]
    assert max(np.abs(moved).ravel()) > 0.002 * size[0]


def test_the_corners_are_darker_and_the_blur_keeps_the_light() -> None:
    light = np.full((*NoisyCamera(HEAD, (128, 96), CameraNoise()).wide.size[::-1], 3), 0.2, np.float32)
    plain = NoisyCamera(HEAD, (128, 96), CameraNoise()).develop(light, 1.0)
    dark = NoisyCamera(HEAD, (128, 96), CameraNoise(vignette=0.4)).develop(light, 1.0)
    assert plain[48, 64] == pytest.approx(dark[48, 64], abs=0.1) and (dark[0, 0] < 0.85 * plain[0, 0]).all()
    assert plain.std() < 0.01
    spot = light.copy()
    spot[50:52, 60:62] = 0.6
    sharp, soft = (NoisyCamera(HEAD, (128, 96), CameraNoise(blur=b)).develop(spot, 1.0) for b in (0.0, 5.0))
    assert soft.max() < sharp.max() - 10 and soft.mean() == pytest.approx(sharp.mean(), abs=0.05)


def test_brightness_follows_light_up_to_white() -> None:
    light = np.repeat(np.linspace(0.0, 4.0, 200, dtype=np.float32)[:, None], 3, axis=1)
    shown = tone_map(light, CameraNoise())
    assert shown[0, 0] == pytest.approx(0.0, abs=1e-6) and shown[-1, 0] > 0.995 and (np.diff(shown[:, 0]) >= 0).all()
    assert tone_map(np.full((1, 3), 0.2159, np.float32), CameraNoise())[0, 0] == pytest.approx(
        0.502, abs=0.002
    )  # sRGB 128
    red = np.array([[0.5, 0.1, 0.1]], np.float32)
    assert (
        np.ptp(tone_map(red, CameraNoise(saturation=0.5)))
        < np.ptp(tone_map(red, CameraNoise()))
        < np.ptp(tone_map(red, CameraNoise(contrast=1.3)))
    )
    assert tone_map(np.zeros((1, 3), np.float32), CameraNoise(haze=0.1)).min() > 0.1
    assert (
        0.0
        <= tone_map(light, CameraNoise(contrast=1.4, saturation=1.3)).min()
        <= tone_map(light, CameraNoise(contrast=1.4)).max()
        <= 1.0
    )


def test_the_meter_makes_dark_rooms_as_bright_as_light_ones() -> None:
    light = np.random.default_rng(0).uniform(0.1, 0.6, (20, 30, 3))
    lens = CameraNoise(key=0.5)
    assert auto_exposure(light / 7, lens) == pytest.approx(7 * auto_exposure(light, lens))
    shown = tone_map(np.full((1, 3), 0.3) * auto_exposure(np.full((4, 4, 3), 0.3), lens), lens)
    assert shown.mean() == pytest.approx(0.5, abs=0.02)


def test_the_sensors_noise_is_as_large_as_it_says_and_the_seeds_own() -> None:
    pixels = np.full((200, 300, 3), 100.4)
    one, other = (add_sensor_noise(pixels, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    assert one.dtype == np.uint8
    assert one.std() == pytest.approx(np.hypot(NOISE, 1 / np.sqrt(12)), rel=0.02) and one.mean() == pytest.approx(
        100.4, abs=0.05
    )
    assert to_uint8(np.array([-3.0, 0.4, 254.6, 300.0])).tolist() == [0, 0, 255, 255]
