"""Frames of a camera that moves are put together from other pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import load_aligner, load_bank, save_bank
from embodiedreamer_gym.vis_aligner.bank import Bank, Entry
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.condition import ROBOT, TABLE
from embodiedreamer_gym.vis_aligner.moving_bench import make_moving_bench
from embodiedreamer_gym.vis_aligner.moving_view import assemble, compose_view
from embodiedreamer_gym.vis_aligner.surfaces import in_front, map_back
from tests.vis_aligner.moving import HEIGHT, MATRIX, WIDTH, scene

WAY = [(0.02 * k, 0.01 * k) for k in range(9)]
GRID = [(x, y) for x in (0.0, 0.1, 0.2, 0.3) for y in (-0.15, 0.0, 0.15)]


@pytest.fixture(scope="module")
def bench() -> Bench:
    return make_moving_bench([scene(GRID[:6], 1.0, "a"), scene(GRID[6:], 0.8, "b")])


def error(made: np.ndarray, true: np.ndarray, where: np.ndarray) -> float:
    """Mean absolute difference, of 255."""
    return float(np.abs(made.astype(float) - true)[where].mean())


def test_a_frame_follows_the_camera_from_the_last_one_alone() -> None:
    film = scene(WAY)
    made = assemble(film.references(0), film.condition.part(1, 5))
    copied, free = np.repeat(film.frames[:1], 4, axis=0), film.condition.classes[1:5] != ROBOT
    assert error(made, film.frames[1:5], free) < 0.3 * error(copied, film.frames[1:5], free)
    hand = film.condition.classes[1:5] == ROBOT
    assert np.array_equal(made[hand], film.frames[1:5][hand])


def test_edges_of_the_hand_are_not_left_behind_on_the_table() -> None:
    """A real picture shows the hand a pixel wider than the simulator."""
    film, number = scene(WAY[::-1]), 2  # backwards, so that what was beside the hand comes into the open
    made = assemble(film.references(0), film.condition.part(number, number + 1))[0]
    table = film.condition.classes[number] == TABLE
    bright = table & (film.frames[number] > 60).all(axis=-1)
    assert ((made < 40).all(axis=-1) & bright).sum() < 3


def test_nothing_is_seen_of_what_is_behind_a_camera() -> None:
    film = scene([(0.0, 0.0)])
    now = film.condition.projections[0, 1].astype(float)
    matrix, axes = MATRIX, np.linalg.solve(MATRIX, now[:, :3])
    turned = matrix @ np.diag([-1.0, 1.0, -1.0]) @ axes  # it looks back
    back = map_back(np.column_stack([turned, np.zeros(3)]), now, None)
    assert not in_front(back, (WIDTH, HEIGHT)).any() and in_front(np.eye(3), (WIDTH, HEIGHT)).all()


def test_what_the_last_frame_did_not_show_comes_from_the_bench(bench: Bench) -> None:
    film = scene([(0.0, 0.0), (0.25, 0.1)])
    table = film.condition.classes[1:] == TABLE
    bare, known = (
        error(assemble(film.references(0, b), film.condition.part(1, 2)), film.frames[1:], table) for b in (None, bench)
    )
    assert known < 6 and known < 0.4 * bare, (known, bare)


def test_it_stays_in_the_exposure_of_the_episode(bench: Bench) -> None:
    film = scene([(0.0, 0.0), (0.25, 0.1)], exposure=0.65)
    table = film.condition.classes[1:] == TABLE
    made = assemble(film.references(0, bench), film.condition.part(1, 2))
    ratio = made[table].astype(float).mean() / film.frames[1:][table].mean()
    assert abs(ratio - 1) < 0.08, ratio  # photos of the bench are 1.2 and 1.5 times as bright


def test_an_atlas_has_one_exposure_and_the_table_at_its_height(bench: Bench) -> None:
    atlas = bench.atlas
    assert atlas is not None and atlas.height == pytest.approx(0.7, abs=1e-3) and atlas.seen.mean() > 0.5
    film = scene(GRID)
    colours, valid = atlas.shown(film.condition)
    ratios = [np.median(colours[k][valid[k]] / (film.frames[k][valid[k]] + 1.0)) for k in range(len(film))]
    assert np.ptp(ratios) < 0.06, ratios  # 0.8 to 1 in the photos
    assert valid.any(axis=(1, 2)).all() and not valid[film.condition.classes != TABLE].any()


def test_an_episode_begins_with_a_view_composed_of_photos(bench: Bench) -> None:
    film = scene([(0.15, 0.05)], exposure=0.9)  # between those of the photos
    made = compose_view(bench, film.condition, film.class_names)
    for number, share in ((TABLE, 0.15), (ROBOT, 0.5), (0, 0.6), (3, 0.5)):
        where = film.condition.classes[0] == number
        raw = error(film.condition.rgb[0], film.frames[0], where)
        assert where.any() and error(made, film.frames[0], where) < share * raw, number
    unknown = compose_view(replace(bench, gallery=None, atlas=None, things={}), film.condition, film.class_names)
    assert np.array_equal(unknown, film.condition.rgb[0])


def test_objects_keep_their_look_from_photos(bench: Bench) -> None:
    """The mark is not in the first frame; without photos of it there is nothing to take."""
    film = scene([(-0.2, -0.2), (0.15, 0.05)])
    mark = film.condition.classes[1:] == 3
    assert mark.any() and not (film.condition.classes[0] == 3).any() and list(bench.things) == ["mark"]
    with_photos, without = (
        error(assemble(film.references(0, b), film.condition.part(1, 2)), film.frames[1:], mark)
        for b in (bench, replace(bench, things={}))
    )
    assert with_photos < 35 and with_photos < 0.5 * without, (with_photos, without)


def test_the_assembled_aligner_needs_no_network_and_gives_each_clip_its_frames() -> None:
    aligner, film = load_aligner("assembled"), scene(WAY)
    references, conditions = (
        [film.references(0), film.references(2)],
        [film.condition.part(1, 5), film.condition.part(3, 7)],
    )
    frames = aligner.render(references, conditions)
    assert np.array_equal(frames[1], assemble(references[1], conditions[1])) and len(frames) == 2
    with pytest.raises(VisionError, match="one size and length"):
        aligner.render(references, [conditions[0], film.condition.part(1, 3)])


def test_a_bank_keeps_what_moving_cameras_know(bench: Bench, tmp_path) -> None:
    film = scene([(0.15, 0.05)])
    frame, classes = film.frames[0], film.condition.classes[0]
    bank = Bank(frame, (Entry(frame, classes, props=("mark",)),), None, bench)
    save_bank(bank, tmp_path / "bank.npz")
    again = load_bank(tmp_path / "bank.npz").of(["mark"])
    one, other = (b.of(["mark"]).compose(film.condition) for b in (bank, again))
    assert np.array_equal(one, other) and again.moving.atlas.height == bench.atlas.height
    start = again.start(film.condition)
    assert start.atlas is again.moving.atlas and list(start.things) == [3] and not start.seen.any()
    with pytest.raises(VisionError, match="vis bank --moving"):
        replace(bank, moving=None).compose(film.condition)


def test_cameras_that_stand_are_refused(bench: Bench) -> None:
    film = scene(WAY)
    seen, numbers = film.condition, np.array([0, 1, 0, 0, 2], np.uint8)  # table and background are no parts
    still = replace(film, condition=replace(seen, parts=numbers[seen.parts], projections=seen.projections[:, [0, 3]]))
    with pytest.raises(VisionError, match="does not move"):
        make_moving_bench([still])
    with pytest.raises(VisionError, match="at least one"):
        make_moving_bench([])
    assert not still.condition.moving_camera and film.frames.shape[1:] == (HEIGHT, WIDTH, 3)
    covered = replace(seen, classes=np.full_like(seen.classes, ROBOT))  # the hand hides everything
    assert seen.moving_camera and covered.moving_camera
