"""Blind cases: a robot with hidden effects or none, its recordings, and the model that a user starts from.

Besides the effect, every case has errors of link masses +-1.5 %, centres +-2 mm, gains +-5 %, viscous friction +-25 %,
torque noise, and 12-bit encoders with 0.4 mrad noise, as a model of a fault-free robot is not perfect either.
`effect_sizes` draws how large an effect is. The same seed with another effect gives the same robot and motions
otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.motions import MOTIONS, Motion, Span, teleoperation
from embodiedreamer_gym.recordings import Recording, Recordings, save_recording
from embodiedreamer_gym.recordings.hdf5 import COMMAND, EFFORT, LAYOUT_FLAGS, POSITION, VELOCITY, new_hdf5
from embodiedreamer_gym.standin.arms import TRUTH, arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.effect_sizes import draw_values, strength_of
from embodiedreamer_gym.standin.robot import StandIn
from embodiedreamer_gym.standin.span import span_of

Array = np.ndarray

IMPERFECT: dict[str, Any] = {
    "mass_error": 0.015,
    "com_error": 0.002,
    "gain_error": 0.05,
    "viscous_error": 0.25,
}
SENSOR = {"noise": 4e-4, "quantum": 2 * np.pi / 4096, "effort_noise": 0.02, "velocity_noise": 0.01}
ALOHA_HOME = (0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 0.5)


@dataclass(frozen=True, eq=False)
class Case:
    """Recordings for training and testing, the nominal model (JSON), its URDF text, and the ground truth.

    truth: {"effect": name or None, "values": {parameter: {joint or end effector: value}}, "servo": {...}}; with several
    effects {"effects": {name: values}, "servo": {...}}. record: function that logs another motion, under a name, with
    the same robot and sensors.
    """

    train: Recordings
    test: Recordings
    model_json: dict[str, Any]
    urdf: str
    truth: dict[str, Any]
    record: Callable[[Motion, str], Recording] = field(repr=False)

    @property
    def hidden(self) -> dict[str, dict[str, dict[str, float]]]:
        """The hidden effects: name -> parameter -> joint or end effector -> value; empty for a fault-free robot."""
        if "effects" in self.truth:
            return self.truth["effects"]
        return {self.truth["effect"]: self.truth["values"]} if self.truth["effect"] else {}

    def write(self, folder: str | Path) -> Path:
        """Write model, URDF and logs (train/, test/), but not the truth; returns the path of the model.

        Episodes of the ALOHA pair become AgileX HDF5 files without time stamps, other recordings CSV files.
        """
        folder = Path(folder)
        for part, recordings in (("train", self.train), ("test", self.test)):
            (folder / part).mkdir(parents=True, exist_ok=True)
            for recording in recordings:
                if recording.kind == "episode":
                    write_agilex(recording, folder / part / f"{recording.name}.hdf5")
                else:
                    save_recording(recording, folder / part / f"{recording.name}.csv")
        urdf = self.model_json["robot"]["urdf"]
        if ":" not in urdf:
            (folder / urdf).write_text(self.urdf)
        path = folder / "model.json"
        path.write_text(json.dumps(self.model_json, indent=1) + "\n")
        return path


@renamed_arguments(rate="hz")
def draw_case(
    effect: str | Sequence[str] | None,
    arm: str,
    rng: np.random.Generator,
    strength: Literal["faint", "plain", "strong"] | float = "plain",
    held_out: Sequence[str] = ("teleoperation", "slow_ramps"),
    seconds: float = 4.0,
    command_known: Literal["continuous", "linear", "hold"] = "linear",
    declare: str = "linear",
    *,
    learnt: Sequence[str] = ("multisine", "point_to_point"),
    reach: float = 0.7,
    speed: float = 0.8,
    hz: float = 100.0,
    with_command: bool = True,
    with_velocity: bool = True,
    with_effort: bool = True,
    imperfect: Mapping[str, float] | None = None,
    among: Sequence[int] | None = None,
    **sensor: Any,
) -> Case:
    """A case of one arm that plays training motions and held-out motions, `seconds` each.

    effect: a name, several or none; strength: of all effects, a name of STRENGTHS or a number (1.0 is plain); learnt,
    held_out: names of MOTIONS for training and for the held-out test; reach, speed: of every motion, see `span_of`; hz:
    samples per second; with_...: signals that the logs contain besides positions; imperfect: replaces entries of
    IMPERFECT, the errors of the model; among: numbers of the joints on which effects may act, None for all; sensor:
    replaces entries of SENSOR or adds some (jitter, noise, ...).

    Raises: EffectError for an unknown effect or strength, ModelError for an unknown arm or motion.
    """
    urdf, joints, servo = arm_urdf(arm), arm_joints(arm), asdict(TRUTH[arm])
    motion_rng, effect_rng, robot_rng = rng.spawn(3)
    span = span_of(urdf, joints, arm_home(arm), reach, speed)
    train_motions = [_motion(kind, span, motion_rng, seconds) for kind in learnt]
    test_motions = [_motion(kind, span, motion_rng, seconds) for kind in held_out]
    nominal = StandIn(urdf, joints, **servo, timestep=5e-4)
    allowed, size = list(range(len(joints)) if among is None else among), strength_of(strength)
    effects = {
        name: draw_values(name, nominal, train_motions, span, effect_rng, size, allowed, [0]) for name in _names(effect)
    }
    robot = StandIn(urdf, joints, **servo, effects=effects, rng=robot_rng, **{**IMPERFECT, **(imperfect or {})})
    logging: dict[str, Any] = {**SENSOR, "command_known": command_known, "declare": declare, "hz": hz,
                               "with_effort": with_effort, **sensor}  # fmt: skip
    absent: dict[str, Any] = {"command": None} if not with_command else {}
    absent |= {"velocity": None} if not with_velocity else {}

    def record(motion: Motion, name: str) -> Recording:
        log = robot.record(motion, name=name, **logging)
        return log.with_(**absent) if absent else log

    logs = [record(m, f"{m.kind}-{i + 1}") for i, m in enumerate([*train_motions, *test_motions])]
    model = {
        "robot": {"urdf": f"{arm}.urdf", "joints": list(joints), "end_effectors": ["tip"]},
        "servo": {key: list(servo[key]) for key in ("stiffness", "damping")},
        "rotor_inertia": list(servo["rotor_inertia"]),
        "viscous_friction": list(servo["viscous_friction"]),
        "effects": [],
    }
    cut = len(train_motions)
    truth = _truth(effects, joints, ("tip",), robot)
    return Case(Recordings(logs[:cut]), Recordings(logs[cut:]), model, urdf, truth, record)


def aloha_case(
    effect: str | None,
    side: Literal["left", "right"],
    rng: np.random.Generator,
    strength: Literal["faint", "plain", "strong"] | float = "plain",
    episodes: int = 10,
    seconds: float = 10.0,
    command_known: Literal["continuous", "linear", "hold"] = "linear",
) -> Case:
    """A case of teleoperated episodes of the ALOHA pair at 30 Hz, every second one held out; one side has the effect.

    Raises: EffectError for an unknown effect, ModelError for a side that is neither left nor right.
    """
    if side not in ("left", "right"):
        raise ModelError(f"side must be left or right, not '{side}'.")
    assets = Path(str(resources.files("embodiedreamer_gym") / "assets"))
    model = json.loads((assets / "aloha.json").read_text())
    robot_json = model["robot"]
    urdf, joints, tips = assets / "urdf" / "aloha.urdf", robot_json["joints"], robot_json["end_effectors"]
    servo: dict[str, Any] = {**model["servo"], **{k: model[k] for k in ("rotor_inertia", "viscous_friction")}}
    common: dict[str, Any] = {"normalised": robot_json["normalised"], "end_effector_links": tips}
    span = span_of(urdf, joints, np.array(ALOHA_HOME * 2), 0.5, 0.6, common["normalised"])
    motion_rng, effect_rng, robot_rng = rng.spawn(3)
    motions = [teleoperation(span, motion_rng, seconds) for _ in range(episodes)]
    nominal = StandIn(urdf, joints, **servo, timestep=5e-4, **common)
    hurt = [i for i, name in enumerate(joints) if name.startswith(side)]
    arms = [i for i, tip in enumerate(tips) if tip.startswith(side)]
    size = strength_of(strength)
    effects = {
        name: draw_values(name, nominal, motions[:1], span, effect_rng, size, hurt, arms) for name in _names(effect)
    }
    faults = {"effects": effects, "rng": robot_rng, **IMPERFECT}
    robot = StandIn(urdf, joints, **servo, timestep=2e-4, **common, **faults)
    gripper = np.array([name in common["normalised"] for name in joints])
    sensor = {**SENSOR, "quantum": np.where(gripper, 1e-3, SENSOR["quantum"]), "command_known": command_known}

    def record(motion: Motion, name: str) -> Recording:
        return robot.record(motion, hz=30.0, name=name, **sensor).with_(kind="episode")

    logs = [record(m, f"episode_{i}") for i, m in enumerate(motions)]
    model = {**model, "robot": {**robot_json, "urdf": "embodiedreamer:aloha.urdf"}, "effects": []}
    truth = _truth(effects, joints, tips, robot)
    return Case(Recordings(logs[::2]), Recordings(logs[1::2]), model, urdf.read_text(), truth, record)


def write_agilex(recording: Recording, path: str | Path) -> None:
    """Write a recording in the layout of AgileX's collect_data.py, in single precision, without time stamps.

    Source: collect_data.py of agilexrobotics/cobot_magic.
    """
    with new_hdf5(path) as file:
        file.attrs.update(LAYOUT_FLAGS)
        data = {COMMAND: recording.command, POSITION: recording.position}
        data |= {VELOCITY: recording.velocity, EFFORT: recording.effort}
        data["base_action"] = np.zeros((len(recording.time), 2))
        for key, array in data.items():
            if array is not None:
                file.create_dataset(key, data=array.astype(np.float32))


def _names(effect: str | Sequence[str] | None) -> tuple[str, ...]:
    return () if effect is None else (effect,) if isinstance(effect, str) else tuple(effect)


def _motion(kind: str, span: Span, rng: np.random.Generator, seconds: float) -> Motion:
    if kind not in MOTIONS:
        raise ModelError(f"there is no motion '{kind}'; give one of {', '.join(MOTIONS)}.")
    return MOTIONS[kind](span, rng, seconds)


def _truth(effects: Mapping[str, Mapping[str, Array]], joints, tips, robot: StandIn) -> dict[str, Any]:
    named = {
        effect: {
            name: {k: float(v) for k, v in zip(joints if len(array) == len(joints) else tips, array, strict=True) if v}
            for name, array in values.items()
        }
        for effect, values in effects.items()
    }
    servo = {k: v.tolist() for k, v in robot.true.items()}
    if len(named) > 1:
        return {"effects": named, "servo": servo}
    effect = next(iter(named), None)
    return {"effect": effect, "values": named[effect] if effect else {}, "servo": servo}
