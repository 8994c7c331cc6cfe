"""References of scenes that no photo shows."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.bank import UNNAMED, Bank, Entry, make_bank
from embodiedreamer_gym.vis_aligner.bank_files import load_bank, save_bank
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import OBJECT
from embodiedreamer_gym.vis_aligner.reprojection import reproject_gallery
from tests.vis_aligner.lamps import lamps
from tests.vis_aligner.scenes import episode, texture
from tests.vis_aligner.test_reprojection import board, photo


@pytest.fixture(scope="module")
def bank() -> Bank:
    episodes = [episode(seed) for seed in range(6)]
    poses = [{"cup": np.arange(7.0)} for _ in episodes]
    return make_bank(episodes, poses, [np.arange(14.0)] * 6)


def test_the_plate_shows_no_object(bank: Bank) -> None:
    """Where no arm is, it is the bench to within the sensor's noise."""
    robot = np.any([e.classes == 2 for e in bank.entries], axis=0)
    error = np.abs(bank.plate.astype(float) - texture(0))[~robot]
    assert np.median(error) < 1.5 and np.percentile(error, 99) < 6


def test_a_new_scene_gets_its_objects_painted_in(bank: Bank) -> None:
    """Nearer to the true photo than the empty plate and than another photo, on each object."""
    for seed in (20, 21, 22):
        one = episode(seed)
        painted = bank.compose(one.condition)
        for number in (3, 4):
            mask = one.condition.classes[0] == number
            error = [np.abs(p[mask].astype(float) - one.frames[0][mask]).mean() for p in (painted, bank.plate)]
            assert error[0] < 0.25 * error[1]
    with pytest.warns(DeprecationWarning, match="Bank.paint is deprecated; use Bank.compose"):
        assert np.array_equal(painted, bank.paint(one.condition))


def test_a_scene_is_painted_from_photos_of_its_objects(bank: Bank) -> None:
    """A cup of another task is another cup."""
    others = tuple(replace(e, props=("pen", "box")) for e in bank.entries[:2])
    both = replace(bank, entries=bank.entries + others)
    assert both.of(["cup", "mat"]).entries == bank.entries and both.of(["pen", "box"]).entries == others
    unnamed = replace(bank, entries=(replace(bank.entries[0], props=UNNAMED),))
    assert unnamed.of(["pen", "box"]).entries == unnamed.entries
    with pytest.raises(VisionError, match=r"no photo of the bank shows can and box.*cup and mat; pen and box"):
        both.of(["can", "box"])


def test_a_bank_is_of_one_place_of_the_camera() -> None:
    here, there, other = (replace(episode(k), appearance=name) for k, name in enumerate(("a/1", "a/2", "b/1")))
    there = replace(there, frames=there.frames // 2)
    with pytest.raises(VisionError, match="drawn_0 and drawn_1 show two benches, or one bench from two camera places"):
        make_bank([here, there])
    with pytest.raises(VisionError, match="drawn_0 and drawn_2 show two benches"):
        make_bank([here], more=[other])
    assert np.array_equal(make_bank([here], more=[there]).bench.picture, make_bank([here]).bench.picture)


def test_a_bank_survives_its_file(bank: Bank, tmp_path) -> None:
    save_bank(bank, tmp_path / "bank.npz")
    again = load_bank(tmp_path / "bank.npz")
    assert np.array_equal(again.plate, bank.plate) and len(again.entries) == 6
    assert np.array_equal(again.bench.picture, bank.bench.picture)
    assert np.array_equal(again.bench.seen, bank.bench.seen)
    assert np.array_equal(again.entry(2).frame, bank.entry(2).frame)
    assert again.entry(2).props == ("cup", "mat")
    assert again.entry(2).options()["object_poses"]["cup"].tolist() == list(range(7))
    assert [p.name for p in tmp_path.iterdir()] == ["bank.npz"]


def test_a_gallery_survives_its_file(tmp_path) -> None:
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.1, 0.05, 1.1, 0.4)])
    one = Episode("turning", clip.rgb, clip)
    save_bank(make_bank([one]), tmp_path / "bank.npz")
    again, made = load_bank(tmp_path / "bank.npz").bench.gallery, make_bank([one]).bench.gallery
    assert np.array_equal(again.frames, made.frames)
    assert all(
        np.array_equal(a, b) for a, b in zip(vars(again.condition).values(), vars(made.condition).values(), strict=True)
    )


def test_larger_photos_of_the_robot_are_sharper(tmp_path) -> None:
    """A photo of twice the size shows a turned part with a smaller error; only the robot's pixels are kept."""
    places = [(0.0, 0.0, 1.0, 0.0), (0.1, 0.05, 1.1, 0.4), (-0.1, 0.0, 1.0, 0.2)]
    small, large = (board(places, times=times) for times in (1, 2))
    names = ("", "", "", "cup", "mat")
    ones = [Episode("one", np.stack([photo(c, k) for k in range(2)]), c.part(0, 2), class_names=names)
            for c in (small, large)]  # fmt: skip
    save_bank(make_bank(ones[:1], photos=ones[1:]), tmp_path / "bank.npz")
    errors = []
    for gallery in (make_bank(ones[:1]).bench.gallery, load_bank(tmp_path / "bank.npz").bench.gallery):
        found, valid = reproject_gallery(gallery, small.part(2, 3))
        assert valid[0][small.parts[2] > 0].mean() > 0.8
        errors.append(np.abs(found[0].astype(float) - photo(small, 2))[valid[0]].mean())
    assert gallery.condition.size == (128, 96) and not gallery.frames[gallery.condition.parts == 0][:, 0].all()
    assert errors[1] < 0.7 * errors[0]


def test_photos_of_another_bench_or_shape_are_refused() -> None:
    one = episode(0)
    other = replace(one, appearance="other")
    narrow = Episode("narrow", one.frames[:, :, :40], one.condition.crop((slice(None), slice(0, 40))))
    for photos, says in (([other], "show two benches"), ([narrow], "must all have one size, which is a multiple")):
        with pytest.raises(VisionError, match=says):
            make_bank([one], photos=photos)


def test_bad_banks_are_refused(bank: Bank, tmp_path) -> None:
    (tmp_path / "notes.npz").write_text("shopping list")
    for call, says in (
        (lambda: load_bank(tmp_path / "notes.npz"), "not a reference bank"),
        (lambda: load_bank(tmp_path / "none.npz"), "not a reference bank"),
        (lambda: save_bank(bank, tmp_path / "no" / "bank.npz"), "cannot be written: No such file"),
        (lambda: bank.entry(6), r"0 \.\. 5, not 6"),
        (lambda: bank.entry(True), "not True"),
        (lambda: make_bank([]), "at least one episode"),
        (lambda: Bank(bank.plate, ()), "at least one photo"),
        (lambda: Bank(bank.plate[::2], bank.entries), "one size"),
        (lambda: Entry(bank.plate, bank.entries[0].classes).options(), "not known"),
    ):
        with pytest.raises(VisionError, match=says):
            call()


def test_photos_of_objects_survive_their_file(tmp_path) -> None:
    clip = board([(0.0, 0.0, 1.0, 0.0), (0.1, 0.05, 1.1, 0.4)], OBJECT)
    one = Episode("one", np.stack([photo(clip, k) for k in range(2)]), clip, class_names=("", "", "", "cup", "mat"))
    made = make_bank([one])
    save_bank(made, tmp_path / "bank.npz")
    again = load_bank(tmp_path / "bank.npz")
    assert list(made.bench.things) == list(again.bench.things) == ["cup"]
    for name in ("depth", "parts", "projections"):
        ours, theirs = (getattr(bank.bench.things["cup"].condition, name) for bank in (made, again))
        assert np.array_equal(ours, theirs)
    start = again.of(["cup", "mat"]).start(clip.part(1, 2))
    assert list(start.things) == [OBJECT]


@pytest.mark.parametrize("damage", ["no zip", "array", "claim", "frames", "gallery"])
def test_files_that_are_no_bank_are_refused(bank: Bank, tmp_path, damage: str) -> None:
    """In one sentence, and nothing is allocated that the file does not hold."""
    path = tmp_path / "bank.npz"
    save_bank(bank, path)
    if damage == "no zip":
        path.write_bytes(b"PK\x03\x04 torn")
    elif damage == "array":
        np.save(tmp_path / "bank.npy", np.zeros(3))
        path.write_bytes((tmp_path / "bank.npy").read_bytes())
    elif damage == "claim":
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "|u1", "fortran_order": False, "shape": (10**11, 3)})
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("frames.npy", header.getvalue())
    else:
        with np.load(path) as data:
            arrays = dict(data)
        arrays[damage] = arrays[damage][:, :5] if damage in arrays else np.zeros(3)
        np.savez(path, **arrays)
    with pytest.raises(VisionError, match="not a reference bank"):
        load_bank(path)


@pytest.fixture
def lit_bank(bank: Bank) -> Bank:
    """A bank whose bench has a light."""
    light = replace(lamps(), receivers=np.ones(bank.plate.shape[:2], bool))
    assert bank.bench is not None
    return replace(bank, bench=replace(bank.bench, light=light, grain=2.5))


def test_a_light_survives_its_file(lit_bank: Bank, tmp_path) -> None:
    """And a file of an earlier version, which has none, loads as before."""
    save_bank(lit_bank, tmp_path / "bank.npz")
    found, light = load_bank(tmp_path / "bank.npz").bench, lit_bank.bench.light
    assert found is not None and found.light is not None and light is not None
    for key in ("positions", "strengths", "receivers", "matrix"):
        assert np.array_equal(getattr(found.light, key), getattr(light, key)), key
    assert found.grain == 2.5
    assert np.allclose(found.light.plane.normal, light.plane.normal) and found.light.plane.offset == light.plane.offset
    rewrite(
        tmp_path / "bank.npz", lambda arrays: {k: v for k, v in arrays.items() if "light" not in k and k != "version"}
    )
    again = load_bank(tmp_path / "bank.npz").bench
    assert again is not None and again.light is None


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"version": np.array(99)}, "version 99"),
        ({"light.plane": np.zeros(3)}, "plane"),
        ({"bench.grain": np.array(np.nan)}, "grain"),
        ({"light.strengths": np.array([-1.0, 1.0])}, "negative"),
        ({"light.positions": np.full((2, 3), np.nan)}, "finite"),
        ({"light.positions": np.zeros((5000, 3))}, "5000 points"),
        ({"light.receivers": np.ones((3, 3), bool)}, "light of that size"),
        ({"light.matrix": np.array(["a"])}, "not a reference bank"),
        ({"bench": np.zeros((48, 64, 3))}, "bench is not uint8"),
    ],
)
def test_a_light_that_cannot_be_is_refused(lit_bank: Bank, tmp_path, change, sentence: str) -> None:
    save_bank(lit_bank, tmp_path / "bank.npz")
    rewrite(tmp_path / "bank.npz", lambda arrays: arrays | change)
    with pytest.raises(VisionError, match=sentence) as error:
        load_bank(tmp_path / "bank.npz")
    assert "\n" not in str(error.value)


def rewrite(path, change) -> None:
    """Change the arrays of a file."""
    with np.load(path) as data:
        arrays = {key: data[key] for key in data.files}
    np.savez_compressed(path, **change(arrays))
