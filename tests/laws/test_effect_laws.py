"""Laws that every effect keeps, run over the whole catalogue and a user's file without a line per effect."""

from __future__ import annotations

import time
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE, SignalLaw, find_effect, load_effects
from embodiedreamer_gym.effects.laws import check_laws
from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive, simulate, simulate_sets
from tests.bank import BUILT_IN, energy, fast, plain, robot, still

USERS = Path(__file__).with_name("user_effects.py")
EFFECTS = load_effects(USERS)
PASSIVE = [name for name, kind in EFFECTS.items() if kind.passive]
COMMAND = [n for n, kind in EFFECTS.items() if issubclass(kind, SignalLaw) and kind.stage == "command"]
DOCS = Path(__file__).parents[2] / "docs" / "effects.md"
FELT = [name for name, kind in EFFECTS.items() if kind.stage != "clock"]

every_effect = pytest.mark.parametrize("effect", EFFECTS)
every_robot = pytest.mark.parametrize("name", BUILT_IN)


def difference(a, b) -> float:
    return max(float(np.abs(a.position - b.position).max()), float(np.abs(a.velocity - b.velocity).max()))


@every_robot
@every_effect
def test_off_is_the_identity(effect: str, name: str) -> None:
    model = robot(name)
    recording = fast(model)
    off = model.with_effect(EFFECTS[effect])
    a, b = simulate(model, recording), simulate(off, recording)
    assert np.abs(a.position - recording.position).max() > 0.02, "the motion is too slow to prove anything"
    np.testing.assert_allclose(b.position, a.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(b.torque, a.torque, rtol=0, atol=1e-7)


@pytest.mark.parametrize("effect", FELT)
def test_a_plain_size_shows(effect: str) -> None:
    model = robot("so101")
    recording = fast(model)
    changed = model.with_effect(plain(model, EFFECTS[effect]))
    assert difference(simulate(model, recording), simulate(changed, recording)) > 1e-3


@every_robot
@every_effect
def test_a_batch_equals_single_runs(effect: str, name: str) -> None:
    model = robot(name)
    recordings = [fast(model, 1.0, seed=1), fast(model, 0.6, seed=2)]
    singles = [
        model.with_(stiffness=model.stiffness * gain).with_effect(plain(model, EFFECTS[effect], share))
        for gain, share in ((1.0, 0.0), (0.9, 1.0), (1.1, 0.6))
    ]
    groups = {"stiffness": np.stack([m.stiffness for m in singles])}
    for p in EFFECTS[effect].parameters:
        values = [list(m.effects[0].values[p.name].values()) for m in singles]
        groups[f"{effect}.{p.name}"] = np.array(values)
    batch = simulate_sets(singles[0], recordings, groups)
    for k, single in enumerate(singles):
        for run, recording in zip(batch, recordings, strict=True):
            alone = simulate(single, recording)
            np.testing.assert_allclose(run.position[k], alone.position, rtol=0, atol=1e-10)
            np.testing.assert_allclose(run.torque[k], alone.torque, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("effect", PASSIVE)
def test_friction_never_adds_energy(effect: str) -> None:
    """An arm without power swings from rest: its energy, at the end of each step, does not rise."""
    model = _unpowered()
    free, worst = _free_swing()
    assert worst < 0.02 * free, "without friction the energy should only waver by the error of the step"
    lost, rise = _swing(model.with_effect(plain(model, EFFECTS[effect], 0.3)))
    assert rise <= 0.02 * free
    assert lost >= -0.02 * free


def _unpowered() -> RobotModel:
    return robot("arm6").with_(stiffness=np.zeros(6), damping=np.zeros(6), viscous_friction=np.zeros(6))


@lru_cache
def _free_swing() -> tuple[float, float]:
    return _swing(_unpowered())


def _swing(model: RobotModel, dt: float = 1e-3) -> tuple[float, float]:
    """Energy lost in 0.8 s of free fall and the largest rise above the lowest energy so far, J.

    Without friction: the energy of the motion instead of the loss.
    """
    drive = Drive(model, dt=dt)
    pose = np.array([[0.3, -0.5, 0.9, 0.4, 0.3, 0.2]])
    drive.start(pose, np.zeros((1, 6)), pose)
    levels, moving = [], 0.0
    for _ in range(800):
        before, q = drive.velocity, drive.position
        drive.advance(drive.accelerate(pose))
        v = (before + drive.velocity)[0] / 2
        levels.append(energy(model, q[0], v))
        moving = max(moving, levels[-1] - energy(model, q[0], 0 * v))
    rise = float(np.max(levels - np.minimum.accumulate(levels)))
    return (moving if not model.effects else levels[0] - levels[-1]), rise


@every_robot
@pytest.mark.parametrize("effect", COMMAND)
def test_memory_starts_at_rest(effect: str, name: str) -> None:
    model = robot(name)
    recording = still(model)
    run = simulate(model.with_effect(plain(model, EFFECTS[effect])), recording)
    np.testing.assert_allclose(run.position, recording.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.velocity, 0.0, atol=1e-8)


@every_effect
def test_it_passes_the_check_of_a_users_file_in_no_time(effect: str) -> None:
    seconds = []
    for _ in range(3):  # of processor time; the least of three, for a busy machine's caches lengthen it
        begun = time.process_time()
        check_laws(EFFECTS[effect])
        seconds.append(time.process_time() - begun)
    assert min(seconds) < 0.2, "a file of effects has to load at once"


@every_effect
def test_words_are_one_sentence(effect: str) -> None:
    kind = EFFECTS[effect]
    assert kind.__doc__ and effect == kind.name and effect.isidentifier() and effect.islower()
    for text in (kind.symptom, kind.reveals):
        assert text == " ".join(text.split()) and 10 < len(text) < 120
        assert not text.endswith((".", ",", ";", ":")) and ". " not in text
        assert text[0].islower() or text.split()[0].isupper(), "it stands in the middle of other sentences"
    assert set(kind.confused_with) <= set(EFFECTS) - {effect}
    assert set(kind.generalises) <= set(EFFECTS) - {effect}


@every_effect
def test_a_model_with_it_survives_its_file(effect: str, tmp_path: Path) -> None:
    model = robot("aloha").with_effect(plain(robot("aloha"), EFFECTS[effect], 1 / 3))
    model.save(tmp_path / "b.json")
    back = RobotModel.load(tmp_path / "b.json", EFFECTS)
    assert back.effects == model.effects
    assert back.effects[0].values == model.effects[0].values
    assert repr(back.parameters()) == repr(model.parameters())
    back.save(tmp_path / "c.json")
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "c.json").read_bytes()


@pytest.mark.skipif(not DOCS.is_file(), reason="docs/effects.md is not written yet")
@pytest.mark.parametrize("effect", CATALOGUE)
def test_the_docs_list_it(effect: str) -> None:
    assert f"`{effect}`" in DOCS.read_text()


def test_a_users_effect_takes_part_and_the_catalogue_stays_as_it_is() -> None:
    assert set(EFFECTS) - set(CATALOGUE) == {"hose_spring", "eccentric_gear", "seal_friction", "heavy_rotor"}
    assert find_effect("hose_spring", EFFECTS).stage == "load"
    with pytest.raises(EffectError, match=r"hose_spring.*known effects: command_delay, "):
        find_effect("hose_spring")


HEAD = "from embodiedreamer_gym.effects import Parameter, SignalLaw\n"
EFFECT = HEAD + "class A(SignalLaw):\n    name = {name!r}\n    stage = 'load'\n    parameters = ()\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def broken(:", "SyntaxError"),
        ("1 / 0", "ZeroDivisionError"),
        ("import no_such_module", "no_such_module"),
        ("", "defines no effect"),
        (HEAD, "defines no effect"),
        (EFFECT.format(name="payload"), "'payload', a name that is taken"),
        (EFFECT.format(name="a") + "class B(A):\n    pass\n", "'a', a name that is taken"),
        (HEAD + "Parameter('x', 'm', off=2.0, low=0.0, high=1.0, typical=0.5)", "off value 2.0 is outside"),
    ],
)
def test_a_bad_file_is_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(EffectError, match=words) as caught:
        load_effects(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(EffectError, match="does not exist"):
        load_effects(tmp_path / "no.py")
    (tmp_path / "effects.txt").write_text(EFFECT.format(name="a"))
    with pytest.raises(EffectError, match=r"must end in \.py"):
        load_effects(tmp_path / "effects.txt")
