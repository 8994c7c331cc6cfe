"""What is rigid is carried to where the simulator has moved it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import Episode, Gallery, References
from embodiedreamer_gym.vis_aligner.condition import OBJECT, ROBOT, Condition
from embodiedreamer_gym.vis_aligner.network_inputs import (
    Inputs,
    allowed,
    reprojected_frames,
    reprojected_pixels,
    to_frames,
)
from embodiedreamer_gym.vis_aligner.object_photos import photos_of_objects
from embodiedreamer_gym.vis_aligner.reprojection import Change, reproject_gallery

HEIGHT, WIDTH, FOCAL = 48, 64, 60.0
MATRIX = np.array([[FOCAL, 0, 31.5], [0, FOCAL, 23.5], [0, 0, 1]])


def turn(angle: float) -> np.ndarray:
    """About the camera's axis."""
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def board(places: list[tuple[float, float, float, float]], kind: int = ROBOT, times: int = 1) -> Condition:
    """A square board of 0.3 m at x, y, z (m) turned by an angle, all of one simulated colour; beside it nothing.

    times: how many times as large the pictures are.
    """
    rows, columns = np.mgrid[: times * HEIGHT, : times * WIDTH]
    middle = 0.5 * (times - 1)
    matrix = np.array([[times, 0, middle], [0, times, middle], [0, 0, 1]]) @ MATRIX
    rays = np.linalg.inv(matrix) @ np.stack([columns, rows, np.ones_like(rows)]).reshape(3, -1)
    seen, projections = [], []
    for x, y, z, angle in places:
        points = (rays * z - np.array([[x], [y], [z]])).T @ turn(angle)
        inside = (np.abs(points[:, :2]) < 0.15).all(axis=1).reshape(rows.shape)
        seen.append(inside)
        projections.append(matrix @ np.column_stack([turn(angle), [x, y, z]]))
    there = np.stack(seen)
    depth = np.where(there, np.array([p[2] for p in places])[:, None, None], 5.0).astype(np.float32)
    rgb = np.where(there[..., None], 90, 210).astype(np.uint8).repeat(3, 3)
    return Condition(rgb, there.astype(np.uint8) * kind, depth, there.astype(np.uint8),
                     np.stack(projections)[:, None].astype(np.float32))  # fmt: skip


def photo(condition: Condition, number: int) -> np.ndarray:
    """What a real camera shows: the board is painted with stripes and a slope."""
    rows, columns = np.mgrid[: condition.size[1], : condition.size[0]]
    pixels = np.stack([columns, rows, np.ones_like(rows)]).reshape(3, -1) * condition.depth[number].reshape(-1)
    projection = condition.projections[number, 0].astype(float)
    points = np.linalg.inv(projection[:, :3]) @ (pixels - projection[:, 3:])
    colours = np.stack([128 + 80 * np.sin(25 * points[0]), 128 + 500 * points[1], 128 + 60 * np.cos(30 * points[1])])
    picture = np.where(condition.parts[number].reshape(-1) > 0, colours, 40).clip(0, 255)
    return picture.T.reshape(*rows.shape, 3).astype(np.uint8)


MOVES = [(0.05, 0.02, 1.0, 0.0), (-0.1, 0.05, 1.0, 0.7), (0.0, 0.0, 0.8, -0.4), (0.1, -0.1, 1.3, 2.5)]


@pytest.mark.parametrize("place", MOVES, ids=str)
def test_a_moved_part_looks_as_it_did(place) -> None:
    """Shifted, turned, nearer and further: all that was in view, to within what lies between two pixels."""
    clip = board([(0.0, 0.0, 1.0, 0.0), place])
    found, carried = Change(clip.part(0, 1), clip.part(1, 2)).reproject(photo(clip, 0))
    there = clip.parts[1] > 0
    assert carried[0][there].mean() > 0.9 and not carried[0][~there].any()
    error = np.abs(found[0].astype(float) - photo(clip, 1))[carried[0]]
    still = np.abs(photo(clip, 0).astype(float) - photo(clip, 1))[carried[0]]
    assert np.median(error) < 3 and error.mean() < 0.25 * still.mean()


def test_what_stands_is_not_touched_and_what_was_hidden_is_not_known() -> None:
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.2, 0.0, 1.0, 0.0)])
    assert not Change(clip.part(0, 1), clip.part(1, 2)).reproject(photo(clip, 0))[1].any()
    half = replace(clip.part(0, 1), parts=np.where(np.arange(WIDTH) < 32, clip.parts[:1], 0))
    carried = Change(half, clip.part(2, 3)).reproject(photo(clip, 0))[1][0]
    assert 0.3 < carried[clip.parts[2] > 0].mean() < 0.7  # the right half was behind something
    nearer = replace(clip.part(0, 1), depth=clip.depth[:1] - 0.1)
    assert not Change(nearer, clip.part(2, 3)).reproject(photo(clip, 0))[1].any()


def test_a_part_of_one_colour_that_slides_along_itself_differs() -> None:
    """No simulated pixel in its middle changes, but the part is another one there."""
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.05, 0.0, 1.0, 0.0)])
    inside = (clip.parts[0] > 0) & (clip.parts[1] > 0)
    assert Change(clip.part(0, 1), clip.part(1, 2)).differs[0][inside].all()
    assert not Change(clip.part(0, 1).without_parts(), clip.part(1, 2).without_parts()).differs[0][inside].any()


def test_carried_parts_are_what_a_frame_is_made_of() -> None:
    """From the last frame, and from the anchor though the last frame is spoilt; a window of the picture says the same."""
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.06, 0.0, 1.0, 0.3)])
    references = References.start(photo(clip, 0), clip.part(0, 1))
    found = reprojected_pixels(references, clip.part(1, 2), Inputs())
    there = Change(clip.part(0, 1), clip.part(1, 2)).reproject(photo(clip, 0))[1][0]
    error = np.abs(to_frames(found.still)[0].astype(float) - photo(clip, 1))
    assert error[there].mean() < 5 and not found.stale[0, 0].numpy()[there].any()
    spoilt = replace(references, last=np.zeros_like(references.last))
    _, anchor, _ = to_frames(reprojected_pixels(spoilt, clip.part(1, 2), Inputs()).sources)[0]
    assert np.abs(anchor.astype(float) - photo(clip, 1))[there].mean() < 5
    window = (slice(8, 40), slice(16, 56))
    small = reprojected_pixels(references.crop(window), clip.part(1, 2).crop(window), Inputs()).still
    same = there[window] & ((small[0] - found.still[0][:, *window]).abs().amax(0).numpy() < 1e-3)
    assert same.sum() > 0.9 * there[window].sum()


def test_a_gallery_shows_a_part_from_the_side_that_is_seen() -> None:
    """Each part from the photo in which it faces the camera most alike, from the next best where that does not show it."""
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.1, 0.05, 1.1, 0.4), (-0.1, 0.0, 1.0, 0.2)])
    photos = np.stack([photo(clip, 0), photo(clip, 1)])
    found, carried = reproject_gallery(Gallery(photos, clip.part(0, 2)), clip.part(2, 3))
    there = clip.parts[2] > 0
    error = np.abs(found[0].astype(float) - photo(clip, 2))[carried[0]]
    assert carried[0][there].mean() > 0.9 and not carried[0][~there].any() and np.median(error) < 4
    away = replace(clip.part(0, 2), projections=clip.projections[:2].copy())
    away.projections[0, 0, 2, :3] *= -1  # the first photo shows its back
    spoilt = np.stack([np.zeros_like(photos[0]), photos[1]])
    assert (reproject_gallery(Gallery(spoilt, away), clip.part(2, 3))[0][0][carried[0]].mean(axis=1) > 20).mean() > 0.9
    hidden = replace(clip.part(0, 2), parts=clip.parts[:2] * np.array([0, 1], np.uint8)[:, None, None])
    assert (
        np.median(
            np.abs(reproject_gallery(Gallery(spoilt, hidden), clip.part(2, 3))[0][0].astype(float) - photo(clip, 2))[
                carried[0]
            ]
        )
        < 5
    )
    assert not reproject_gallery(None, clip.part(2, 3))[1].any()
    with pytest.raises(VisionError, match="a gallery needs photos"):
        Gallery(photos, clip.part(0, 2).without_parts())


def test_an_object_that_was_covered_gets_its_look_from_photos() -> None:
    """Neither the last nor the first frame shows it, and without photos its pixels are stale."""
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.1, 0.05, 1.1, 0.4), (-0.1, 0.0, 1.0, 0.2)], OBJECT)
    names = ("background", "table", "robot", "cup")
    photos = photos_of_objects(
        [Episode("one", np.stack([photo(clip, k) for k in range(2)]), clip.part(0, 2), class_names=names)]
    )
    assert list(photos) == ["cup"] and 1 <= len(photos["cup"]) <= 2
    there, nothing = clip.parts[2] > 0, np.zeros_like(clip.parts[:1])
    covered = replace(clip.part(0, 1), parts=nothing, classes=nothing)
    bare = References.start(np.full((HEIGHT, WIDTH, 3), 40, np.uint8), covered)
    stale = []
    for references in (bare, replace(bare, things={OBJECT: photos["cup"]})):
        still, _, unknown = reprojected_frames(references, clip.part(2, 3), Inputs())
        stale.append(unknown[0][there].mean())
        known = there & ~unknown[0]
    assert stale[0] == 1 and stale[1] < 0.3  # the edges of photos are left out
    assert np.median(np.abs(still[0].astype(float) - photo(clip, 2))[known]) < 5


def test_what_a_model_may_not_see_is_not_carried() -> None:
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.06, 0.0, 1.0, 0.3)], kind=OBJECT)
    references = References.start(photo(clip, 0), clip.part(0, 1))
    for inputs in (replace(Inputs(), reproject=False), replace(Inputs(), masks=False)):
        one = allowed(clip.part(1, 2), inputs)
        start = replace(references, last_condition=allowed(clip.part(0, 1), inputs))
        assert not Change(start.last_condition, one).reproject(references.last)[1].any()
    unknown = clip.without_parts(OBJECT)
    assert not unknown.parts.any() and board([MOVES[0]]).without_parts(OBJECT).parts.any()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"projections": None}, "need their projections"),
        ({"depth": None}, "need their projections and depth"),
        ({"projections": np.zeros((2, 1, 4, 4))}, r"must be \(2, L, 3, 4\)"),
        ({"projections": np.zeros((1, 1, 3, 4))}, r"must be \(2, L, 3, 4\)"),
        ({"parts": np.zeros((2, 4, 4), np.uint8)}, "parts must be"),
    ],
)
def test_parts_that_do_not_fit_are_refused(change, says) -> None:
    clip = board(MOVES[:2])
    with pytest.raises(VisionError, match=says):
        replace(clip, **change)
