"""A user's file of effects: what breaks a law is refused in one sentence that names the effect and the law."""

from __future__ import annotations

from pathlib import Path

import pytest

from embodiedreamer_gym.cli import command as cli
from embodiedreamer_gym.effects import CATALOGUE, load_effects
from embodiedreamer_gym.errors import EffectError

HEAD = """
import numpy as np
from embodiedreamer_gym.effects import MechanicsChange, Parameter, SignalLaw, TorqueBudget

SIZE = Parameter("size", "1", off=0.0, low=0.0, high=1.0, typical=0.2)
BOTH = Parameter("size", "1", off=0.0, low=-1.0, high=1.0, typical=0.2)
TOP = Parameter("size", "N m", off=9.0, low=0.1, high=9.0, typical=2.0)
SHAPE = Parameter("width", "rad", off=0.1, low=0.01, high=1.0, typical=0.1, shape=True)

class Words:
    symptom = "the motion is wrong"
    reveals = "any motion"
    parameters = (SIZE,)

"""


def effect(base: str, method: str, *lines: str) -> str:
    """A class `mine`; lines: its attributes (no indent at all), then the statements of its method (one indent)."""
    arguments = {"law": "signal, joint, memory, p", "friction": "joint, p", "drive": "joint, p",
                 "change": "mechanics, p"}[method]  # fmt: skip
    own = [line for line in lines if not line.startswith(" ")]
    body = [f"       {line}" for line in lines if line.startswith(" ")]
    text = [f"class Mine(Words, {base}):", '    name = "mine"', *(f"    {line}" for line in own)]
    return HEAD + "\n".join([*text, "    @staticmethod", f"    def {method}({arguments}):", *body, ""])


def law(stage: str, *lines: str) -> str:
    return effect("SignalLaw", "law", f'stage = "{stage}"', *lines)


def load(tmp_path: Path, text: str):
    path = tmp_path / "mine.py"
    path.write_text(text)
    return load_effects(path)


def sentence(tmp_path: Path, text: str) -> str:
    """What a broken file is answered with."""
    with pytest.raises(EffectError) as caught:
        load(tmp_path, text)
    said = str(caught.value)
    assert said.startswith(f"effects file {tmp_path / 'mine.py'}: effect ") and "\n" not in said
    assert said.count("(law '") == 1 and said.endswith("').")
    return said


BROKEN = {
    "off, a scale": ("off", "identity when its parameters are off", law("drive", " return signal * p.size, memory")),
    "off, a shape": ("off", "identity",
                     law("load", "parameters = (SIZE, SHAPE)", " return signal + 1e-3 * p.width, memory")),
    "off, friction": ("off", "no friction", effect("TorqueBudget", "friction", " return p.size + 1e-3, p.size")),
    "off, a limit": ("off", "limits of np.inf", effect(
        "TorqueBudget", "drive", "parameters = (TOP,)", " top = np.minimum(p.size, 5.0)",
        " return top, top, np.inf, np.inf, np.inf")),
    "off, mass": ("off", "changes the mass", effect("MechanicsChange", "change", " mechanics.mass += 0.1")),
    "off, gravity": ("off", "changes the gravity", effect(
        "MechanicsChange", "change", " mechanics.gravity = mechanics.gravity * 1.01")),
    "shape, one row": ("shape", "returns shape (3,) for a signal (7, 3)", law("load", " return signal[0], memory")),
    "shape, no pair": ("shape", "(signal, memory)", law("load", " return signal + p.size")),
    "shape, friction": ("shape", "tuple of 2", effect("TorqueBudget", "friction", " return p.size")),
    "shape, drive": ("shape", "tuple of 5", effect("TorqueBudget", "drive", " return p.size, p.size")),
    "shape, too wide": ("shape", "returns shape (7, 1, 3) as friction", effect(
        "TorqueBudget", "friction", " return p.size[:, None], p.size")),
    "shape, mechanics": ("shape", "leaves the mass with shape", effect(
        "MechanicsChange", "change", " mechanics.mass = mechanics.mass[0]")),
    "shape, it fails": ("shape", "TypeError", law("load", " return signal + p.size * 'x', memory")),
    "shape, no such parameter": ("shape", "AttributeError", law("load", " return signal + p.weight, memory")),
    "finite, a limit": ("finite", "NaN or inf", law(
        "servo", "parameters = (TOP,)", " return signal * p.size / (1 + p.size), memory")),
    "finite, a root": ("finite", "NaN or inf", law("load", " return signal - p.size * joint.velocity**0.5, memory")),
    "finite, friction": ("finite", "NaN or inf", effect(
        "TorqueBudget", "friction", " return p.size / joint.velocity * np.inf, p.size")),
    "finite, mechanics": ("finite", "rotor_inertia NaN", effect(
        "MechanicsChange", "change", " mechanics.rotor_inertia = mechanics.rotor_inertia + np.log(p.size)")),
    "passive, friction": ("passive", "pushes along the motion", effect(
        "TorqueBudget", "friction", "parameters = (BOTH,)", " return p.size, p.size")),
    "passive, drag": ("passive", "pushes along the motion", effect(
        "TorqueBudget", "friction", " torque = p.size * joint.velocity", " return torque, torque")),
    "passive, drive": ("passive", "limit of its drive is negative", effect(
        "TorqueBudget", "drive", "parameters = (TOP,)", " return p.size - 3.0, p.size, np.inf, np.inf, np.inf")),
    "passive, negative damping": ("passive", "more work than it takes", law(
        "load", "passive = True", " return signal + p.size * joint.velocity, memory")),
    "passive, a late spring": ("passive", "more work than it takes", law(
        "load", "passive = True", " late = joint.position if memory is None else memory",
        " return signal - p.size * late, joint.position")),
    "passive, a push round and round": ("passive", "more work than it takes", law(
        "load", "passive = True", " return signal - p.size * np.roll(joint.position, 1, axis=1), memory")),
    "pure, in place": ("pure", "in place", law("load", " signal += p.size", " return signal, memory")),
    "pure, the joints": ("pure", "in place", law(
        "load", " joint.position = 0 * joint.position", " return signal + p.size * joint.position, memory")),
    "pure, the parameters": ("pure", "in place", effect(
        "TorqueBudget", "friction", " p.size = np.abs(p.size)", " return p.size, p.size")),
    "pure, random": ("pure", "not deterministic", law(
        "sensor", " return signal + p.size * np.random.default_rng().normal(size=signal.shape), memory")),
    "pure, a hidden state": ("pure", "not deterministic", law(
        "load", "seen = [0.0]", " Mine.seen[0] += 0.1", " return signal + p.size * Mine.seen[0], memory")),
    "pure, a random mass": ("pure", "not deterministic", effect(
        "MechanicsChange", "change", " mechanics.mass *= 1 + p.size[:, :1] * np.random.default_rng().random()")),
    "pure, friction that counts": ("pure", "not deterministic", effect(
        "TorqueBudget", "friction", "seen = [0.0]", " Mine.seen[0] += 0.1",
        " return p.size * Mine.seen[0], p.size")),
    "batch, a mean": ("batch", "mixes its parameter sets", law(
        "drive", " return signal * (1 - p.size * joint.position.mean()), memory")),
    "batch, friction": ("batch", "mixes its parameter sets", effect(
        "TorqueBudget", "friction", " top = np.max(np.abs(joint.torque), axis=0)",
        " return p.size * top, p.size * top")),
    "batch, mechanics": ("batch", "mixes its parameter sets", effect(
        "MechanicsChange", "change", " mechanics.mass += p.size[:, :1] * mechanics.mass.mean() * len(p.size)")),
    "rest": ("rest", "moves while its command stands still", law(
        "command", " memory = memory + p.size * 0.1 * (signal - memory)", " return memory * (p.size > 0) + signal * (p.size == 0), memory",
        "start = staticmethod(lambda signal, p, dt: 0 * signal)")),
    "memory, of a joint": ("memory", "shape (3,) for 7", law(
        "load", " return signal + p.size, joint.position[0]")),
    "memory, a list": ("memory", "keeps a list", law("load", " return signal + p.size, [joint.position]")),
    "memory, in place": ("pure", "memory in place", law(
        "sensor", " memory[:] += p.size", " return signal + memory, memory",
        "start = staticmethod(lambda signal, p, dt: 0 * signal)")),
    "memory, a command's in place": ("pure", "memory in place", law(
        "command", " memory[:] = p.size", " return signal + p.size, memory",
        "start = staticmethod(lambda signal, p, dt: 0 * signal)")),
    "mechanics, a light link": ("mechanics", "mass negative", effect(
        "MechanicsChange", "change", "parameters = (BOTH,)", " mechanics.mass = mechanics.mass + 3 * p.size[:, :1]")),
    "mechanics, a light rotor": ("mechanics", "rotor_inertia negative", effect(
        "MechanicsChange", "change", "parameters = (BOTH,)",
        " mechanics.rotor_inertia = mechanics.rotor_inertia + p.size")),
    "mechanics, a negative gap": ("mechanics", "gap negative", effect(
        "MechanicsChange", "change", " mechanics.gap = mechanics.gap - p.size")),
    "mechanics, not symmetric": ("mechanics", "not symmetric", effect(
        "MechanicsChange", "change", " mechanics.inertia[:, 0, 0, 1] += p.size[:, 0]")),
    "mechanics, an inertia": ("mechanics", "inertia negative inside", effect(
        "MechanicsChange", "change", " mechanics.inertia[:, 0] -= p.size[:, :1, None] * np.eye(3)")),
    "mechanics, mass without inertia": ("mechanics", "add_point_mass", effect(
        "MechanicsChange", "change", " mechanics.mass[:, 0] += p.size[:, 0]",
        " mechanics.first_moment[:, 0] += p.size[:, :1] * np.array([0.3, 0.0, 0.0])")),
    "a declaration without a name": ("declaration", "effect Mine has the name None",
                                     law("load", " return signal + p.size, memory").replace('name = "mine"', "")),
    "a name of two words": ("declaration", "plain word",
                            law("load", " return signal + p.size, memory").replace('"mine"', '"my own"')),
    "no stage": ("declaration", "has the stage None", effect("SignalLaw", "law", " return signal + p.size, memory")),
    "another stage": ("declaration", "one of command, servo", law("motor", " return signal + p.size, memory")),
    "no symptom": ("declaration", "has no symptom", law("load", "symptom = ''", " return signal, memory")),
    "no reveals": ("declaration", "has no reveals", law("load", "reveals = None", " return signal, memory")),
    "no parameters": ("declaration", "has no parameters", law("load", "parameters = ()", " return signal, memory")),
    "no tuple": ("declaration", "with its comma", law("load", "parameters = (SIZE)", " return signal, memory")),
    "twice": ("declaration", "'size' twice", law("load", "parameters = (SIZE, TOP)", " return signal, memory")),
    "only shapes": ("declaration", "only shape parameters", law("load", "parameters = (SHAPE,)", " return signal, memory")),
    "confused": ("declaration", "not a tuple of names",
                 law("load", "confused_with = ('joint_spring')", " return signal, memory")),
    "generalises": ("declaration", "generalises that is not a tuple",
                    law("load", "generalises = ('torque_bias')", " return signal, memory")),
    "per arm": ("declaration", "per arm; on the stage 'load' values are per joint", law(
        "load", "parameters = (Parameter('x', 'm', 0.0, 0.0, 1.0, 0.1, per='arm'),)", " return signal, memory")),
    "a passive sensor": ("declaration", "passive on the stage 'sensor'",
                         law("sensor", "passive = True", " return signal + p.size, memory")),
    "no law": ("declaration", "defines no law", HEAD + "class A(Words, SignalLaw):\n    name = 'a'\n    stage = 'load'\n"),
    "no budget": ("declaration", "no friction and no drive", HEAD + "class A(Words, TorqueBudget):\n    name = 'a'\n"),
    "no static method": ("declaration", "law that is not a @staticmethod",
                         law("load", " return signal, memory").replace("@staticmethod", "")),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_law_is_named(tmp_path: Path, case: str) -> None:
    name, words, text = BROKEN[case]
    said = sentence(tmp_path, text)
    assert f"(law '{name}')" in said and words in said, said


PARAMETERS = {
    "'x', '', 0.0, 0.0, 1.0, 0.1": "without a unit",
    "'my x', 'm', 0.0, 0.0, 1.0, 0.1": "not a plain word",
    "'name', 'm', 0.0, 0.0, 1.0, 0.1": "'name'",
    "'x', 'm', 0.0, 0.0, 0.0, 0.1": "the lower one must be less",
    "'x', 'm', 0.0, -1.0, 1.0, -0.1": "must be positive and inside",
    "'x', 'm', 0.0, -1.0, 1.0, 2.0": "must be positive and inside",
    "'x', 'm', 0.5, 0.0, 1.0, 0.5": "at which it is off",
    "'x', 'm', float('inf'), 0.0, float('inf'), 0.5": "not finite",
    "'x', 'm', 0.0, 0.0, 1.0, 0.5, scale='mass'": "allowed are '', 'torque'",
    "'x', 'm', 0.0, 0.0, 1.0, 0.5, starts=(0.5,)": "only shape parameters may have starts",
}


@pytest.mark.parametrize("arguments", PARAMETERS)
def test_an_absurd_parameter_is_named(tmp_path: Path, arguments: str) -> None:
    text = law("load", f"parameters = (Parameter({arguments}),)", " return signal + p.x, memory")
    said = sentence(tmp_path, text)
    assert "(law 'declaration')" in said and PARAMETERS[arguments] in said, said


SOUND = {
    "a push": law("load", "parameters = (BOTH,)", " return signal + p.size, memory"),
    "a passive spring": law("load", "passive = True", " return signal - p.size * (joint.position - 0.4), memory"),
    "passive damping": law("load", "passive = True", " return signal - p.size * joint.velocity, memory"),
    "a spring that bites late": law(
        "load", "passive = True", " return signal - p.size * np.maximum(joint.position - 0.1, 0.0) ** 2, memory"),
    "friction of a number": effect("TorqueBudget", "friction", " return p.size, 0.0"),
    "a limit of numbers": effect(
        "TorqueBudget", "drive", "parameters = (TOP,)", " return p.size, p.size, np.inf, np.inf, np.inf"),
    "a memory of numbers": law(
        "load", " count, last = memory or (0, joint.position)",
        " return signal + p.size * (joint.position - last), (count + 1, joint.position)"),
    "a link of another mass": effect(
        "MechanicsChange", "change", " share = 1 + p.size[:, :1]", " mechanics.mass = mechanics.mass * share",
        " mechanics.first_moment = mechanics.first_moment * share[..., None]",
        " mechanics.inertia = mechanics.inertia * share[..., None, None]"),
    "what two share": law("load", " return signal + p.size, memory").replace('name = "mine"', "").replace(
        "class Mine", "class Shared") + "class A(Shared):\n    name = 'a'\nclass B(Shared):\n    name = 'b'\nC = B\n",
}  # fmt: skip


@pytest.mark.parametrize("case", SOUND)
def test_a_sound_effect_is_let_in(tmp_path: Path, case: str) -> None:
    found = set(load(tmp_path, SOUND[case])) - set(CATALOGUE)
    assert found == ({"a", "b"} if case == "what two share" else {"mine"})


def test_the_command_says_so_and_exits_with_2(tmp_path: Path, capsys) -> None:
    path = tmp_path / "mine.py"
    path.write_text(BROKEN["passive, friction"][2])
    code = cli.main(["compare", "--model", "so101", "--effects", str(path), str(tmp_path / "log.csv")])
    out, err = capsys.readouterr()
    assert code == 2 and out == "" and err.count("\n") == 1
    assert err.startswith(f"error: effects file {path}: effect mine gives energy") and "(law 'passive')" in err
