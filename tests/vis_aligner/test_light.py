"""Shadows where they fall, the light from photos, and pictures in another light."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.pipelines.prepare import write_episode
from embodiedreamer_gym.vis_aligner import load_episode
from embodiedreamer_gym.vis_aligner.bench import make_bench
from embodiedreamer_gym.vis_aligner.clip import Episode, References
from embodiedreamer_gym.vis_aligner.condition import ROBOT, TABLE
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.light import carried_light, relit
from embodiedreamer_gym.vis_aligner.light_fit import fit_light
from embodiedreamer_gym.vis_aligner.shadows import hulls_before_camera, intrinsics, lit_pixels
from tests.vis_aligner.lamps import DISTANCE, EDGE, LAMPS, MATRIX, PLANE, SIZE, board, filmed, lamps, view

OVER = np.array([[0.0, 0.0, 0.3]])  # m: a place of the block


def test_the_intrinsics_are_those_of_the_projections() -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert np.allclose(intrinsics((MATRIX @ turn)[None, None] @ np.eye(3, 4)), MATRIX, atol=1e-6)


def test_a_shadow_lies_where_rays_meet_the_block() -> None:
    """Pixel by pixel: whether the segment from the table to the lamp goes through the block."""
    (lit,) = lit_pixels(hulls_before_camera(view(OVER), MATRIX), LAMPS[:1], PLANE, MATRIX, SIZE)
    points, _ = PLANE.seen(MATRIX, SIZE)
    way = LAMPS[0] - points
    middle = OVER[0] * (1, 1, -1) + (0, 0, DISTANCE)
    near, far = ((middle + side * EDGE / 2 - points) / way for side in (-1, 1))
    hidden = np.minimum(near, far).max(axis=2) < np.maximum(near, far).min(axis=2)
    assert 20 < hidden.sum() < 400
    assert ((lit[0] == 0) != hidden).sum() < 0.2 * hidden.sum()  # of the outline's pixels, half


def test_only_what_moves_changes_the_shade() -> None:
    """Each frame's shade is the same alone and in a clip, the same bits where nothing moves."""
    places = np.repeat(OVER, 3, axis=0)
    places[2, 0] += 0.1
    shade = lamps().shade(view(places))
    assert np.array_equal(shade[0], shade[1]) and (np.abs(shade[2] - shade[0]) > 0.1).sum() > 20
    assert np.allclose(shade[2:], lamps().shade(view(places[2:])), atol=1e-6)
    assert shade.min() > 0.2 and shade.max() < 1.0001


def test_a_picture_goes_into_another_light_and_back() -> None:
    places = np.array([OVER[0], (0.1, 0.05, 0.3)])
    condition = lamps().on(view(places))
    here, there = condition.part(0, 1), condition.part(1, 2)
    picture = relit(board(), 1.0, condition.shade[0])
    assert np.array_equal(carried_light(picture, here, here)[0], picture)
    moved = carried_light(picture, here, there)[0]
    table = (condition.classes == TABLE).all(axis=0)
    assert np.abs(moved[table].astype(int) - relit(board(), 1.0, condition.shade[1])[table]).max() <= 2
    assert np.abs(carried_light(moved, there, here)[0][table].astype(int) - picture[table]).max() <= 3
    thing = condition.classes[0] == ROBOT
    assert np.array_equal(moved[thing], picture[thing])  # a thing keeps its colours
    assert np.array_equal(carried_light(picture, view(OVER), there)[0], picture)  # the light is not known


@pytest.fixture(scope="module")
def bench():
    """What is known from forty photos."""
    return make_bench([filmed(40)])


def test_the_light_is_found_from_photos(bench) -> None:
    """Shadows of places that no photo shows, and the table without any: far better than the median of the photos."""
    unseen = filmed(12, seed=5, noise=0.0)
    true, found = lamps().shade(unseen.condition), bench.light.shade(unseen.condition)
    table = unseen.condition.classes == TABLE
    error = np.sqrt(np.mean((found - true)[table] ** 2)) / np.sqrt(np.mean((1 - true)[table] ** 2))
    assert len(bench.light.strengths) <= 20 and bench.light.strengths.min() > 0
    assert error < 0.45  # of sharp shadows of two lamps
    assert np.abs(bench.picture.astype(float) - board())[bench.seen].mean() < 4
    photos = filmed(40)
    median = make_bench([replace(photos, condition=replace(photos.condition, hulls=None))])
    assert median.light is None
    made = relit(bench.picture, 1.0, found)[table].astype(float)
    plain = np.broadcast_to(median.picture, unseen.frames.shape)[table].astype(float)
    assert np.mean((made - unseen.frames[table]) ** 2) < 0.25 * np.mean((plain - unseen.frames[table]) ** 2)


def test_photos_whose_shadows_are_others_give_no_light() -> None:
    """Nor do few."""
    episode = filmed(24)
    views = [episode.condition.part(k, k + 1) for k in range(24)]
    assert fit_light(list(episode.frames)[:7], views[:7]) is None
    rng = np.random.default_rng(0)
    assert (
        fit_light([np.clip(rng.normal(180, 20, board().shape), 0, 255).astype(np.uint8) for _ in views], views) is None
    )


def test_references_carry_the_light(bench) -> None:
    """The plate shows no shadows, also of what an episode uncovers; a frame after a chunk has its shade."""
    episode = filmed(9, seed=7)
    references = References.start(episode.frames[0], episode.condition.part(0, 1), bench)
    assert references.last_condition.shade is not None
    after = references.after(episode.frames[1:], episode.condition.part(1, 9))
    assert np.array_equal(after.last_condition.shade[0], bench.light.shade(episode.condition.part(8, 9))[0])
    bare = replace(bench, seen=np.zeros_like(bench.seen))
    plate = References.start(episode.frames[0], episode.condition.part(0, 1), bare)
    known = plate.seen
    assert np.abs(plate.plate[known].astype(float) - board()[known]).mean() < 6
    assert np.abs(episode.lit(bare).references(0, bare).plate[known].astype(int) - plate.plate[known]).max() == 0
    assert np.array_equal(episode.references(5, bare).plate, episode.lit(bare).references(5, bare).plate)


def test_shadows_move_in_generated_frames(bench) -> None:
    """With weights whose gates are shut: only what is reprojected, and the shadows."""
    network = Lean(LeanConfig((8, 8, 8, 16)))
    torch.nn.init.constant_(network.out.bias, -10.0)
    aligner = LeanAligner(network, chunk=4)
    places = np.column_stack([np.linspace(-0.2, 0.2, 9), np.zeros(9), np.full(9, 0.35)])
    condition = view(places)
    truth = relit(board(), 1.0, lamps().shade(condition))
    episode = Episode("moving", truth, condition)
    errors = []
    for known in (bench, replace(bench, light=None)):
        frames = aligner.render([episode.references(0, known)], [condition.part(1, 5)])[0]
        far = (condition.classes[1:5] == TABLE) & (np.abs(np.arange(SIZE[0]) - 24) < 24)
        errors.append(np.mean((frames.astype(float) - truth[1:5])[far] ** 2))
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"positions": np.zeros((2, 2))}, "positions"),
        ({"strengths": np.array([-1.0, 1.0])}, "negative"),
        ({"positions": -LAMPS}, "above the table"),
        ({"matrix": np.zeros((3, 3))}, "matrix invertible"),
        ({"strengths": np.array([np.nan, 1.0])}, "finite"),
    ],
)
def test_a_light_that_cannot_be_is_refused(change, sentence: str) -> None:
    with pytest.raises(VisionError, match=sentence):
        replace(lamps(), **change)


def test_pictures_of_another_size_are_refused() -> None:
    with pytest.raises(VisionError, match="64, 48"):
        lamps().shade(view(OVER).crop((slice(0, 20), slice(0, 20))))


def test_a_film_with_hulls_survives_its_file_and_larger_hulls_are_not_read(tmp_path) -> None:
    path, key = tmp_path / "film.hdf5", "observations/sim/head/hulls"
    write_episode(filmed(2), path)
    assert np.array_equal(load_episode(path).condition.hulls, filmed(2).condition.hulls)
    with h5py.File(path, "a") as file:
        del file[key]
        file.create_dataset(key, (40_000_000, 14), "u1", chunks=(64, 14))  # a few kB that become GB
    with pytest.raises(VisionError, match=r"film\.hdf5: .*hulls has shape \(40000000, 14\).*must be \(1, 14, 3\)"):
        load_episode(path)
