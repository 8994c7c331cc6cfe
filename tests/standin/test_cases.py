import json

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import EffectError, ModelError
from embodiedreamer_gym.motions import MOTIONS
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.standin.arms import arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.cases import aloha_case, draw_case
from embodiedreamer_gym.standin.effect_sizes import SIZES
from embodiedreamer_gym.standin.hidden import EFFECTS
from embodiedreamer_gym.standin.span import span_of

SECONDS = 1.2


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def plain():
    return draw_case(None, "pendulum1", rng(), seconds=SECONDS)


@pytest.mark.parametrize("effect", SIZES)
def test_every_effect_shows_in_the_motions_to_learn_from(effect, plain):
    case = draw_case(effect, "pendulum1", rng(), strength="strong", seconds=SECONDS)
    assert set(case.truth["values"]) <= set(EFFECTS[effect])
    assert case.truth["effect"] == effect
    signal = "time" if CATALOGUE[effect].stage == "clock" else "position"
    difference = [getattr(a, signal) - getattr(b, signal) for a, b in zip(case.train, plain.train, strict=True)]
    assert max(np.abs(d).max() for d in difference) > 2e-3


def test_what_a_case_holds(plain):
    assert [r.kind for r in plain.train] == ["multisine", "point_to_point"]
    assert [r.kind for r in plain.test] == ["teleoperation", "slow_ramps"]
    assert plain.truth["effect"] is None
    assert plain.truth["values"] == {}
    assert plain.model_json["effects"] == []
    assert plain.train[0].command_hold == "linear"
    given, true = plain.model_json["servo"]["stiffness"][0], plain.truth["servo"]["stiffness"][0]
    assert 0 < abs(true / given - 1) <= 0.05


def test_a_seed_gives_one_case_and_the_next_draw_another(plain):
    again, stream = draw_case(None, "pendulum1", rng(), seconds=SECONDS), rng()
    np.testing.assert_array_equal(again.test[0].position, plain.test[0].position)
    first, second = (draw_case("coulomb_friction", "pendulum1", stream, seconds=SECONDS) for _ in range(2))
    assert first.truth["values"] != second.truth["values"]


def test_strength_and_sensor_can_be_chosen():
    both = (draw_case("torque_bias", "pendulum1", rng(), strength=s, seconds=SECONDS) for s in ("faint", "strong"))
    sizes = [case.truth["values"] for case in both]
    faint, strong = (abs(values["torque"]["joint1"]) for values in sizes)
    assert strong == pytest.approx(faint * 2.5 / 0.3)
    other = {"held_out": ("hold_poses", "staircase"), "hz": 50.0, "quantum": 0.01}
    coarse = draw_case(None, "pendulum1", rng(), seconds=SECONDS, **other)
    assert coarse.train[0].hz == pytest.approx(50.0)
    assert [r.kind for r in coarse.test] == ["hold_poses", "staircase"]


def test_a_strength_may_be_a_number():
    named, number = (draw_case("torque_bias", "pendulum1", rng(), s, seconds=SECONDS) for s in ("strong", 2.5))
    assert named.truth == number.truth
    for strength in (0.0, "huge"):
        with pytest.raises(EffectError, match=r"strength.*number.*faint, plain, strong"):
            draw_case("torque_bias", "pendulum1", rng(), strength)


def test_two_effects_are_both_hidden():
    names = ("torque_bias", "coulomb_friction")
    both = draw_case(names, "pendulum1", rng(), seconds=SECONDS)
    alone = draw_case("torque_bias", "pendulum1", rng(), seconds=SECONDS)
    assert tuple(both.truth["effects"]) == tuple(both.hidden) == names
    assert "effect" not in both.truth
    assert alone.hidden == {"torque_bias": both.hidden["torque_bias"]}  # the first is drawn as if it were the only one
    assert alone.truth == draw_case(["torque_bias"], "pendulum1", rng(), seconds=SECONDS).truth
    assert np.abs(both.train[0].position - alone.train[0].position).max() > 2e-3


def test_motions_rate_and_signals_can_be_chosen(plain):
    motions = {"learnt": ("staircase",), "held_out": ("hold_poses", "multisine"), "reach": 0.1}
    signals = {"with_command": False, "with_velocity": False, "hz": 50.0}
    case = draw_case(None, "pendulum1", rng(), seconds=SECONDS, **motions, **signals)
    assert [r.kind for r in (*case.train, *case.test)] == ["staircase", "hold_poses", "multisine"]
    log = case.train[0]
    assert log.command is None and log.velocity is None and log.effort is not None
    assert log.hz == pytest.approx(50.0)
    assert np.ptp(case.test[1].position) < 0.3 < np.ptp(plain.train[0].position)
    assert draw_case(None, "pendulum1", rng(), seconds=SECONDS, with_effort=False).train[0].effort is None
    with pytest.raises(ModelError, match="no motion 'dance'; give one of multisine"):
        draw_case(None, "pendulum1", rng(), learnt=("dance",))


def test_a_log_without_command_is_written_without_it(tmp_path):
    draw_case(None, "pendulum1", rng(), seconds=SECONDS, with_command=False).write(tmp_path)
    for path in tmp_path.rglob("*.csv"):
        assert ".command" not in path.read_text()
    assert all(log.command is None for log in load_recordings(tmp_path / "train"))


def test_the_same_robot_can_make_one_more_recording(plain):
    motion = MOTIONS["staircase"](plain_span(), rng(5), SECONDS)
    one, other = (draw_case(e, "pendulum1", rng(), "strong", seconds=SECONDS) for e in (None, "torque_bias"))
    first, second = (case.record(motion, "extra") for case in (one, other))
    assert (first.name, first.kind, first.hz) == ("extra", "staircase", pytest.approx(100.0))
    np.testing.assert_array_equal(first.command, second.command)
    assert np.abs(first.position - second.position).max() > 2e-3  # the effect is still there


def plain_span():
    return span_of(arm_urdf("pendulum1"), arm_joints("pendulum1"), arm_home("pendulum1"))


def test_a_six_joint_case_names_joints_and_end_effectors():
    case = draw_case("payload", "arm6", rng(), seconds=0.5)
    assert case.truth["values"]["mass"].keys() == {"tip"}
    offset = draw_case("encoder_offset", "arm6", rng(1), seconds=0.5).truth["values"]["angle"]
    assert offset and "joint1" not in offset  # a vertical axis cannot show it


def test_a_case_is_written_without_its_truth(tmp_path, plain):
    path = plain.write(tmp_path)
    model = json.loads(path.read_text())
    assert (tmp_path / model["robot"]["urdf"]).read_text() == plain.urdf
    logs = load_recordings(tmp_path / "train")
    assert sorted(r.kind for r in logs) == ["multisine", "point_to_point"]
    written = {p.name for p in tmp_path.rglob("*") if p.is_file()}
    assert len(written) == 6


def test_aloha_episodes_are_agilex_files_without_time_stamps(tmp_path):
    case = aloha_case("coulomb_friction", "left", rng(), episodes=2, seconds=1.0)
    assert all(joint.startswith("left") for joint in case.truth["values"]["torque"])
    case.write(tmp_path)
    with h5py.File(tmp_path / "train" / "episode_0.hdf5") as file:
        assert file["observations/qpos"].shape == file["action"].shape == (31, 14)
        assert "timestamps" not in file
        assert not file.attrs["sim"]
    (log,) = load_recordings(tmp_path / "train" / "*.hdf5", hz=30.0)
    assert log.units == (("rad",) * 6 + ("1",)) * 2
    np.testing.assert_allclose(log.position, case.train[0].position, atol=1e-6)


def test_wrong_names_are_refused():
    with pytest.raises(EffectError, match="no cases of 'ghost'; give one of command_delay"):
        draw_case("ghost", "pendulum1", rng())
    with pytest.raises(ModelError, match="no stand-in arm"):
        draw_case(None, "arm9", rng())
    with pytest.raises(ModelError, match="left or right, not 'top'"):
        aloha_case(None, "top", rng())


def test_the_former_keyword_of_the_sampling_frequency_works_with_a_warning() -> None:
    with pytest.warns(DeprecationWarning, match="'rate' of draw_case is now 'hz'"):
        case = draw_case(None, "pendulum1", np.random.default_rng(0), seconds=1.0, rate=50.0)
    assert case.train[0].hz == pytest.approx(50.0)
