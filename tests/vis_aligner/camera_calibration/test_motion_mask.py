"""Evidence: what moves before a background that does not."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.vis_aligner.camera_calibration.motion_mask import foreground_of_motion

HEIGHT, WIDTH = 60, 80


def scene(rows: int = 12, step: int = 5, noise: float = 2.0) -> np.ndarray:
    """A dark square that walks over a bright floor with a black line."""
    rng = np.random.default_rng(0)
    frames = np.full((rows, HEIGHT, WIDTH, 3), 180.0)
    frames[:, :, 40:42] = 20.0
    for t in range(rows):
        frames[t, 20:34, 4 + step * t : 16 + step * t] = 60.0
    return np.clip(frames + rng.normal(0.0, noise, frames.shape), 0, 255).astype(np.uint8)


def test_what_moves_is_found_where_it_is() -> None:
    found = foreground_of_motion(scene())
    assert found.dtype == np.float32 and found.shape == (12, HEIGHT, WIDTH)
    assert found[0, 24:30, 7:13].min() > 0.9
    assert found[0, 45:].max() < 0.1 and found[0, :, 60:].max() < 0.1


def test_a_static_thing_is_none() -> None:
    assert foreground_of_motion(scene(step=0)).max() < 0.1


def test_a_camera_that_shakes_a_little_shows_no_moving_edges() -> None:
    still = scene(step=0, noise=0.0)[..., :]
    shaken = np.stack([np.roll(frame, t % 2, axis=1) for t, frame in enumerate(still)])
    assert foreground_of_motion(shaken)[:, 40:].max() < 0.35


def test_a_faint_shadow_counts_less_than_a_thing() -> None:
    frames = scene()
    shaded = frames.copy()
    shaded[0, 40:50] = np.clip(shaded[0, 40:50].astype(int) - 12, 0, 255)
    found = foreground_of_motion(shaded)
    assert found[0, 42:48, 50:].mean() < 0.3 < 0.9 < found[0, 24:30, 7:13].min()
