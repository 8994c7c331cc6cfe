"""Every example runs, and says what its docstring promises."""

from __future__ import annotations

import ast
import runpy
import sys
import tempfile
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"
SAYS = {
    "01_compare_and_calibrate.py": ("stiffness[joint1]", "calibrated", "Joint joint2 is worst"),
    "02_find_the_missing_effect.py": ("Missing: stribeck_friction on joint1, joint2, joint3.", "index.html"),
    "03_your_own_effect.py": ("greased_friction", "coulomb_friction"),
    "04_make_an_env.py": ("'pixels': (96, 128, 3)", "put the cup on the mat: done True"),
    "05_train_ppo.py": ("after 512 steps of training",),
    "06_sac_her.py": ("goal [", "300 steps"),
    "08_record_demonstrations.py": ("AlohaEpisodes(2 episodes", "0 attempts failed", "'grab the paper cup'"),
    "07_frames_that_look_real.py": ("frames.png",),
    "10_train_a_policy.py": (
        "ActPolicy(Act(head at 64 x 48, chunk 100",
        "success in ",
        "100 actions executed per query",
    ),
    "11_learn_from_preferences.py": ("PreferenceSet(", "log-likelihoods of winners ("),
    "09_augment.py": (
        "2 new episodes; of 0 the replay failed",
        "JoinedEpisodes(3 episodes",
        "states as recorded: True",
    ),
}
ON_A_ROBOT = {"record_lerobot.py", "record_ros2.py"}  # tests/robot/test_play.py runs them
SLOW = ("10_train_a_policy.py",)


def test_each_example_is_known_and_short() -> None:
    files = {path.name: path for path in FOLDER.glob("*.py")}
    assert set(files) == set(SAYS) | ON_A_ROBOT
    for name, path in files.items():
        text = path.read_text()
        assert len(text.splitlines()) <= 40, name
        assert "\n" not in (ast.get_docstring(ast.parse(text)) or "\n"), f"{name}: say its idea in one line"


@pytest.mark.usefixtures("shared_demo")
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in SAYS])
def test_an_example_runs(name: str, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name])
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    runpy.run_path(str(FOLDER / name), run_name="__main__")
    out = capsys.readouterr().out
    assert [part for part in SAYS[name] if part not in out] == []
