"""Hidden cases: the same for a seed, their truth apart, and readable without this package."""

import hashlib
import json
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from embodiedreamer_gym.bench.cases import LEFT_OUT, OBSERVATIONS, TIERS, draw_effects, draw_task, make_cases
from embodiedreamer_gym.bench.task import load_task
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import EmbodieDreamerError


def test_nothing_in_a_case_says_what_it_hides(made):
    shown = "".join(p.read_text() for p in made.cases.rglob("*") if p.is_file() and p.name != "case.json")
    assert made.hidden["0002"].effects and made.hidden["0003"].effects and not made.hidden["0001"].effects
    for hidden in made.hidden.values():
        assert not any(name in shown for name in hidden.effects)
    for folder in (made.folder(case) for case in made.hidden):
        data = json.loads((folder / "case.json").read_text())
        assert set(data) == {"case", "observation", "effects", "joints", "end_effectors", "signal", "predict"}
        assert len(data["effects"]) == len(CATALOGUE) - LEFT_OUT
        assert set(made.hidden[folder.name].effects) <= set(data["effects"])


def test_the_commitment_is_that_of_the_truth(made):
    text = (made.truth / "truth.json").read_bytes()
    assert hashlib.sha256(text).hexdigest() == made.digest
    assert json.loads((made.cases / "bench.json").read_text())["truth_sha256"] == made.digest
    for case, row in json.loads(text)["cases"].items():
        for name, digest in row["withheld_sha256"].items():
            file = made.truth / "withheld" / case / f"{name}.csv"
            assert hashlib.sha256(file.read_bytes()).hexdigest() == digest


def test_what_is_withheld_is_not_among_what_is_given(made):
    for case, hidden in made.hidden.items():
        task = load_task(made.folder(case))
        assert {motion.name for motion in task.predict} == set(hidden.withheld)
        for motion in task.predict:
            measured = hidden.withheld[motion.name]
            if task.signal == "position":
                assert np.ptp(motion.position, axis=0).max() == 0 and np.ptp(measured.position, axis=0).max() > 0.05
                assert np.abs(motion.position[0] - measured.position[0]).max() < 0.01
                np.testing.assert_allclose(motion.command, measured.command, atol=1e-8)
            else:
                assert not motion.effort.any() and np.abs(measured.effort).max() > 0.1
            assert motion.name not in {log.name for log in (*task.train, *task.test)}


def test_the_same_seed_draws_the_same_case_again(made, tmp_path):
    row = draw_task(tmp_path / "0003", tmp_path / "secret", "subset", "effort", 2, 2, 1.5)
    assert row.pop("case") == "0003"
    assert row == json.loads((made.truth / "truth.json").read_text())["cases"]["0003"]
    for path in (tmp_path / "0003").rglob("*.*"):
        assert path.read_bytes() == (made.folder("0003") / path.relative_to(tmp_path / "0003")).read_bytes()


def test_the_nominal_robot_is_the_same_in_every_format(made):
    folder = made.folder("0001")
    model, task = mujoco.MjModel.from_xml_path(str(folder / "arm.xml")), load_task(folder)
    assert model.njnt == task.model.n
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], task.model.stiffness)
    joints = [one.get("name") for one in ElementTree.parse(folder / "arm.urdf").getroot().iter("joint")]
    assert set(task.model.joints) <= set(joints)


@pytest.mark.parametrize("tier", TIERS)
@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_names_leave_out_as_many_effects_whatever_is_hidden(tier, observation):
    for seed in range(20):
        effects, names = draw_effects(tier, observation, np.random.default_rng(seed))
        assert len(effects) == {"none": 0, "pair": 2}.get(tier, 1) and len(names) == len(CATALOGUE) - LEFT_OUT
        assert not set(effects) & set(names) if tier == "outside" else set(effects) <= set(names)


def test_a_real_robot_counts_by_its_error_alone(tmp_path):
    make_cases(tmp_path / "cases", tmp_path / "truth", 0, real=[DATA])
    row = json.loads((tmp_path / "truth" / "truth.json").read_text())["cases"]["0001"]
    task = load_task(tmp_path / "cases" / "cases" / "0001")
    assert row["tier"] == "real" and not row["effects"] and len(task.test) == 1 and len(task.predict) == 1
    assert 0 < row["nominal_rms"] < 0.1


@pytest.mark.parametrize(("changes", "said"), [({"tiers": ["many"]}, "many"), ({"observations": [""]}, "not one of")])
def test_a_wrong_choice_is_one_sentence(tmp_path, changes, said):
    with pytest.raises(EmbodieDreamerError, match=said):
        make_cases(tmp_path / "a", tmp_path / "b", 1, **changes)
    assert not (tmp_path / "a").exists()


def test_the_truth_may_not_lie_among_the_cases(tmp_path):
    with pytest.raises(EmbodieDreamerError, match="must be separate"):
        make_cases(tmp_path / "a", tmp_path / "a" / "truth", 1)
