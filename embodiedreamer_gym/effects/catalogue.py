"""The catalogue of physical effects; a new effect is one file and one name here."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from embodiedreamer_gym.effects.backlash import Backlash
from embodiedreamer_gym.effects.base_tilt import BaseTilt
from embodiedreamer_gym.effects.command_delay import CommandDelay
from embodiedreamer_gym.effects.command_lowpass import CommandLowpass
from embodiedreamer_gym.effects.command_rate_limit import CommandRateLimit
from embodiedreamer_gym.effects.command_timing import CommandTiming
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.derivative_on_error import DerivativeOnError
from embodiedreamer_gym.effects.direction_dependent_friction import DirectionDependentFriction
from embodiedreamer_gym.effects.effect import Effect, MechanicsChange, SignalLaw, TorqueBudget
from embodiedreamer_gym.effects.effort_sensor import EffortSensor
from embodiedreamer_gym.effects.encoder_offset import EncoderOffset
from embodiedreamer_gym.effects.friction_compensation import FrictionCompensation
from embodiedreamer_gym.effects.gravity_compensation import GravityCompensation
from embodiedreamer_gym.effects.hysteresis import Hysteresis
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.effects.integral_action import IntegralAction
from embodiedreamer_gym.effects.joint_elasticity import JointElasticity
from embodiedreamer_gym.effects.joint_spring import JointSpring
from embodiedreamer_gym.effects.laws import check_laws
from embodiedreamer_gym.effects.load_friction import LoadFriction
from embodiedreamer_gym.effects.lookahead import Lookahead
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.effects.profile import Profile
from embodiedreamer_gym.effects.pwm_deadband import PwmDeadband
from embodiedreamer_gym.effects.quadratic_drag import QuadraticDrag
from embodiedreamer_gym.effects.rotor_inertia import RotorInertia
from embodiedreamer_gym.effects.servo_deadzone import ServoDeadzone
from embodiedreamer_gym.effects.stribeck_friction import StribeckFriction
from embodiedreamer_gym.effects.supply_sag import SupplySag
from embodiedreamer_gym.effects.timestamp_jitter import TimestampJitter
from embodiedreamer_gym.effects.torque_bias import TorqueBias
from embodiedreamer_gym.effects.torque_constant import TorqueConstant
from embodiedreamer_gym.effects.torque_fade import TorqueFade
from embodiedreamer_gym.effects.torque_ripple import TorqueRipple
from embodiedreamer_gym.effects.torque_saturation import TorqueSaturation
from embodiedreamer_gym.effects.velocity_cascade import VelocityCascade
from embodiedreamer_gym.effects.voltage_limit import VoltageLimit
from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.io.deprecation import present_name

Catalogue = Mapping[str, type[Effect]]

CATALOGUE: Catalogue = {
    effect.name: effect
    for effect in (
        CommandDelay,
        CommandLowpass,
        CommandRateLimit,
        Profile,
        Lookahead,
        ServoDeadzone,
        DerivativeOnError,
        FrictionCompensation,
        GravityCompensation,
        IntegralAction,
        VelocityCascade,
        PwmDeadband,
        SupplySag,
        TorqueSaturation,
        VoltageLimit,
        TorqueConstant,
        TorqueFade,
        CoulombFriction,
        StribeckFriction,
        LoadFriction,
        DirectionDependentFriction,
        Hysteresis,
        QuadraticDrag,
        TorqueBias,
        TorqueRipple,
        JointSpring,
        JointElasticity,
        Backlash,
        RotorInertia,
        Payload,
        BaseTilt,
        EncoderOffset,
        TimestampJitter,
    )
}

RENAMED = {"velocity_limit": "voltage_limit"}

NUISANCES: Catalogue = {kind.name: kind for kind in (CommandTiming, EffortSensor, InertialError)}
"""Nuisance parameters: fits estimate them together with the effects, but a diagnosis never names them."""


def find_effect(name: str, catalogue: Catalogue = CATALOGUE) -> type[Effect]:
    """Return the effect of that name; a former name is accepted with a DeprecationWarning.

    Raises: EffectError that lists the known names.
    """
    name = name if name in catalogue else present_name("effect", name, RENAMED)
    if name not in catalogue:
        raise EffectError(f"there is no effect '{name}'; known effects: {', '.join(catalogue)}.")
    return catalogue[name]


def load_effects(path: str | Path, catalogue: Catalogue = CATALOGUE) -> Catalogue:
    """Return the catalogue with the effects that a user's Python file defines (the file is executed).

    Raises: EffectError if the file is missing, fails to run, defines no effect, uses a name that exists or has an
    effect that violates a law.
    """
    path = Path(path)
    if not path.is_file():
        raise EffectError(f"effects file {path} does not exist.")
    spec = importlib.util.spec_from_file_location(f"embodiedreamer_user_effects_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise EffectError(f"effects file {path} is not a Python file; its name must end in .py.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # report any exception of a user's file as one sentence
        raise EffectError(f"effects file {path} failed: {type(error).__name__}: {error}.") from error
    own = (v for v in vars(module).values() if _is_effect(v) and v.__module__ == module.__name__)
    kinds = list(dict.fromkeys(own))
    bases = {base for kind in kinds for base in kind.__mro__[1:]}
    own_effects: dict[str, type[Effect]] = {}
    for kind in kinds:
        if kind in bases and not hasattr(kind, "name"):
            continue  # a common base class of effects in the file
        name = getattr(kind, "name", None)
        name = name if isinstance(name, str) else kind.__name__
        if name in catalogue or name in NUISANCES or name in own_effects:
            raise EffectError(f"effects file {path} defines '{name}', a name that is taken.")
        own_effects[name] = kind
    if not own_effects:
        raise EffectError(
            f"effects file {path} defines no effect (a subclass of SignalLaw, TorqueBudget or "
            "MechanicsChange with a name)."
        )
    for kind in own_effects.values():
        try:
            check_laws(kind)
        except EffectError as error:
            raise EffectError(f"effects file {path}: {error}") from error
    return {**catalogue, **own_effects}


def _is_effect(value: Any) -> bool:
    kinds = (SignalLaw, TorqueBudget, MechanicsChange)
    return isinstance(value, type) and issubclass(value, kinds) and value not in kinds
