"""The robot on the stand-in's bench, which is the ALOHA pair with hidden effects and random errors, and logs of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.robots import load_robot
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.motions import MOTIONS
from embodiedreamer_gym.recordings import Recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import ALOHA_HOME, IMPERFECT, SENSOR
from embodiedreamer_gym.standin.robot import StandIn
from embodiedreamer_gym.standin.span import span_of

Effects = Mapping[str, Mapping[str, Any]]

ROBOT = "aloha"
LOG_STEP = 2e-4  # s, timestep of the engine when only the arms move
REACH, SPEED = 0.5, 0.6  # range of logged motions: rad around home, and share of the joints' highest speed
GRIPPER_QUANTUM = 1e-3  # of a gripper's stroke


def load_nominal() -> RobotModel:
    """The model that a user starts from."""
    return load_robot(ROBOT)


def build_robot(
    effects: Effects | None = None,
    seed_of_robot: int | None = 0,
    timestep: float = LOG_STEP,
    furnish: Callable[[Any], None] | None = None,
) -> StandIn:
    """The robot; the same seed gives the same link masses and servo gains, which differ slightly from the nominal ones.

    effects: see `hidden`; seed_of_robot: None for a robot without errors; furnish: adds objects, see `build_plant`.
    Raises: EffectError for invalid effects, MissingExtraError without MuJoCo.
    """
    model = load_nominal()
    errors: dict[str, Any] = {} if seed_of_robot is None else IMPERFECT
    return StandIn(
        model.urdf, model.joints, model.stiffness, model.damping, model.rotor_inertia, model.viscous_friction,
        effects=effects, rng=np.random.default_rng(seed_of_robot or 0), normalised=model.normalised,
        end_effector_links=model.arms, timestep=timestep, furnish=furnish, **errors,
    )  # fmt: skip


@renamed_arguments(rate="hz")
def logs(
    effects: Effects | None = None,
    seed_of_robot: int | None = 0,
    count: int = 10,
    seconds: float = 10.0,
    kind: str = "teleoperation",
    hz: float = 30.0,
    seed: int = 0,
) -> Recordings:
    """Episodes of free motion, with an empty table, of the stand-in world's robot for the same effects and seed.

    kind: a name of MOTIONS; hz: samples per second; seed: of the motions. The sensors have the same noise as in the
    stand-in's other logs. The controller ramps from one logged command to the next.
    Raises: ModelError for an unknown motion; EffectError; MissingExtraError without MuJoCo.
    """
    if kind not in MOTIONS:
        raise ModelError(f"there is no motion '{kind}'; give one of {', '.join(MOTIONS)}.")
    robot, model = build_robot(effects, seed_of_robot), load_nominal()
    span = span_of(model.urdf, model.joints, np.array(ALOHA_HOME * 2), REACH, SPEED, model.normalised)
    gripper = np.array([unit == "1" for unit in model.units])
    sensor: dict[str, Any] = {**SENSOR, "quantum": np.where(gripper, GRIPPER_QUANTUM, SENSOR["quantum"])}
    rng = np.random.default_rng(seed)
    return Recordings([
        robot.record(MOTIONS[kind](span, rng, seconds), hz=hz, name=f"{kind}_{i}", command_known="linear",
                     declare="linear", **sensor).with_(kind="episode")
        for i in range(count)
    ])  # fmt: skip
