"""The verb `vis`: from episodes to a model, its measures, a video, references; and what it says of bad input."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.pipelines.prepare import write_episode
from embodiedreamer_gym.vis_aligner import load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.svd import save_svd
from tests.vis_aligner.scenes import episode
from tests.vis_aligner.tiny_svd import tiny_svd


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Episodes of one bench, with poses of the props in the first, and a model of two steps."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "train").mkdir()
    for seed in range(2):
        path = folder / "train" / f"{seed}.hdf5"
        write_episode(episode(seed), path)
        with h5py.File(path, "a") as file:
            file["observations/qpos"] = np.zeros((17, 14))
            for name in ("cup", "mat"):
                file[f"objects/{name}"] = np.tile([0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0], (17, 1))
    write_episode(episode(9), folder / "held_out.hdf5")
    assert main(["vis", "train", str(folder / "train"), "--out", str(folder / "model"), "--steps", "2", "--quiet"]) == 0
    return folder


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main([str(a) for a in arguments])
    return code, *capsys.readouterr()


def test_a_model_is_measured_beside_copying(bench: Path, tmp_path: Path, capsys) -> None:
    code, out, _ = run(capsys, "vis", "evaluate", bench / "held_out.hdf5", "--aligner", bench / "model/lean.pt",
                       "--json", tmp_path / "m.json", "--strips", tmp_path / "strips", "--quiet")  # fmt: skip
    assert code == 0 and all(name in out for name in ("closed loop", "copy last", "copy first", "raw simulation"))
    row = json.loads((tmp_path / "m.json").read_text())["episodes"][0]["measures"]
    psnr = {name: found["values"]["psnr"] for name, found in row.items()}
    assert 5 < psnr["raw simulation"] < psnr["copy last"] < 60
    (strip,) = (tmp_path / "strips").iterdir()
    assert cv2.imread(str(strip)).shape[1] > 64


def test_fine_tuning_goes_on_from_the_model(bench: Path, tmp_path: Path, capsys) -> None:
    code, out, _ = run(capsys, "vis", "fine-tune", bench / "train", "--aligner", bench / "model/lean.pt",
                       "--out", tmp_path, "--steps", 1, "--device", "auto", "--quiet")  # fmt: skip
    assert code == 0 and "lean.pt" in out
    before, after = (
        load_aligner(path).network.state_dict() for path in (bench / "model/lean.pt", tmp_path / "lean.pt")
    )
    largest = max(float((before[name] - after[name]).abs().max()) for name in before)
    assert 0 < largest < 0.05


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_svd_is_trained_from_a_folder_and_makes_a_video(bench: Path, tmp_path: Path, capsys) -> None:
    pytest.importorskip("diffusers", reason="the extra [svd] is not installed")
    save_svd(tiny_svd(chunk=3), tmp_path / "begin")
    saving = ["--bf16", "--decode-chunk-size", 2]
    code, out, _ = run(capsys, "vis", "train", bench / "train", "--model", "svd", "--from", tmp_path / "begin", "--steps", 2, "--batch", 1,
                       "--gradient-checkpointing", *saving, "--out", tmp_path / "svd", "--quiet")  # fmt: skip
    assert code == 0 and "SvdAligner('begin', 3 frames, 4 steps)" in out
    code, _, _ = run(capsys, "vis", "render", bench / "held_out.hdf5", "--aligner", tmp_path / "svd", *saving, "--diffusion-steps", 1,
                     "--out", tmp_path / "generated.mp4")  # fmt: skip
    assert code == 0 and (tmp_path / "generated.mp4").stat().st_size > 1000


def test_an_episode_becomes_a_video(bench: Path, tmp_path: Path, capsys) -> None:
    code, out, _ = run(capsys, "vis", "render", bench / "held_out.hdf5", "--aligner", bench / "model/lean.pt",
                       "--out", tmp_path / "generated.mp4")  # fmt: skip
    video = cv2.VideoCapture(str(tmp_path / "generated.mp4"))
    assert code == 0 and "generated.mp4" in out
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 17


def test_a_bank_is_made_of_first_frames(bench: Path, tmp_path: Path, capsys) -> None:
    code, out, _ = run(capsys, "vis", "bank", bench / "train", "--out", tmp_path / "b.npz")
    assert code == 0 and "b.npz" in out
    bank = load_bank(tmp_path / "b.npz")
    assert bank.size == (64, 48)
    cut = tmp_path / "cut.hdf5"
    cut.write_bytes(sorted((bench / "train").iterdir())[0].read_bytes()[:5000])
    code, _, error = run(capsys, "vis", "bank", cut, "--out", tmp_path / "c.npz")
    assert code == 2 and "damaged, cut short" in error and not (tmp_path / "c.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["train", "none", "--out", "x"], "there is no episode"),
        (["train", "EPISODE", "--out", "x", "--steps", "0"], "--steps: 0 is not a whole number from 1 to"),
        (["train", "EPISODE", "--out", "x", "--model", "svd"], "needs --from"),
        (["evaluate", "EPISODE", "--aligner", "none.pt"], "none.pt"),
        (["evaluate", "EPISODE", "--aligner", "MODEL", "--device", "cuda:97"], "device 'cuda:97' is not available here; use"),
        (["train", "EPISODE", "--out", "x", "--device", "cuda:97"], "device 'cuda:97' is not available here; use auto, cpu"),
        (["train", "EPISODE", "--out", "x", "--bf16"], "are only for svd aligners, but the new model is lean; leave them out"),
        (["render", "EPISODE", "--aligner", "MODEL", "--out", "x.mp4", "--decode-chunk-size", "4"], "are only for svd aligners"),
        (["render", "EPISODE", "EPISODE", "--aligner", "MODEL", "--out", "x.mp4"], "takes one episode, not 2"),
        (["render", "EPISODE", "--aligner", "MODEL", "--out", "x.avi"], "give a file name.mp4"),
        (["prepare", "EPISODE", "--out", "x", "--size", "big"], "--size big is not a width and a height"),
        (["prepare", "EPISODE", "--out", "x", "--object", "red cup"], "masks from text need"),
        (["prepare", "EPISODE", "--out", "x", "--camera", "nose"], "no camera is named 'nose'"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"EPISODE": bench / "held_out.hdf5", "MODEL": bench / "model/lean.pt"}
    code, _, error = run(capsys, "vis", *(names.get(a, a) for a in arguments))
    assert code != 0 and sentence in error and error.count("\n") == 1
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]
