"""Export: motion of plain MuJoCo with only the exported file, compared with the simulation of `compare`.

    python -m benchmarks export [--only NAME ...] [--out FILE.json]

The demo's arm with each effect of the catalogue at its typical size, with none, with several, and with the demo's own
friction; and ALOHA. The demo's recorded commands (for ALOHA: sines) are played in MuJoCo from the exported MJCF. Their
motion is compared with the package's rollouts, mrad, and with rollouts at a sixteenth of the package's step ("fine").
Baseline: the URDF with position actuators of the same gains, at MuJoCo's default time step, without rotor inertia,
friction and effects.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import save

FRICTION = ("coulomb_friction", "stribeck_friction", "direction_dependent_friction", "load_friction")
TARGET, TARGET_FRICTION = 0.3, 1.0  # mrad
SEVERAL = ("command_delay", "coulomb_friction", "payload", "torque_bias", "encoder_offset", "joint_spring")


def with_typical(model: Any, name: str) -> Any:
    """The model with one more effect; parameters have their typical size, or their off value if they have none."""
    model = model.with_effect(name)
    effect = next(one for one in model.effects if one.name == name)
    values = {}
    for p in effect.parameters:
        factor = model.parameter_bounds(p)[1] / p.high
        values[f"{name}.{p.name}"] = dict(zip(model.places(p), (p.typical * factor).tolist(), strict=True))
    return model.with_values(values)


def cases() -> Iterator[tuple[str, Any, list[Any]]]:
    """Name, model and recordings of each case."""
    from embodiedreamer_gym.demo import DATA
    from embodiedreamer_gym.effects import CATALOGUE
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.robot import RobotModel

    arm, logs = RobotModel.load(DATA / "model.json"), list(load_recordings(DATA / "train", DATA / "test"))
    yield "spring and damper alone", arm.with_(viscous_friction=0 * arm.viscous_friction), logs
    yield "and viscous friction", arm, logs
    for name in CATALOGUE:
        yield name, with_typical(arm, name), logs
    truth = json.loads((DATA / "truth.json").read_text())
    servo = {key: np.array(value) for key, value in truth["servo"].items()}
    friction = {f"{truth['effect']}.{key}": value for key, value in truth["values"].items()}
    yield "the demo's robot", arm.with_(**servo).with_effect(truth["effect"]).with_values(friction), logs
    several = arm
    for name in SEVERAL:
        several = with_typical(several, name)
    yield "six effects", several, logs
    aloha = RobotModel.load("aloha")
    yield "aloha", aloha, [sines(aloha)]
    for name in ("coulomb_friction", "torque_saturation"):
        yield f"aloha, {name}", with_typical(aloha, name), [sines(aloha)]


def sines(model: Any) -> Any:
    """Commands for both arms and grippers, from rest."""
    from embodiedreamer_gym.recordings import Recording

    rng, time = np.random.default_rng(0), np.arange(200) / 50
    home = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 0.6] * 2)
    rate, phase = rng.uniform(0.3, 1.2, 14), rng.uniform(0, 6, 14)
    command = home + 0.25 * np.clip(time - 0.3, 0, 1)[:, None] * np.sin(2 * np.pi * time[:, None] * rate + phase)
    position = np.tile(home, (len(time), 1))
    return Recording(
        name="sines", joints=model.joints, time=time, position=position, command=command, units=model.units
    )


def baseline(model: Any, path: Path) -> Path:
    """The model that a user would write without the package: the URDF with position actuators of the same gains."""
    from embodiedreamer_gym.engines.export.joints import plain_joints, scales
    from embodiedreamer_gym.engines.mujoco.bodies import robot_specification
    from embodiedreamer_gym.engines.mujoco.library import mujoco

    spec, (_, gain, zero) = robot_specification(model), scales(model)
    joints = plain_joints(model).of_urdf(gain, zero)
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = 0, 0
    for i, name in enumerate(model.joints):
        spec.joint(name).actfrclimited = 0
        actuator = spec.add_actuator()
        actuator.name = actuator.target = name
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.set_to_position(kp=joints.stiffness[i], kv=joints.damping[i])
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.compile()
    path.write_text(spec.to_xml())
    return path


def gaps(path: Path, model: Any, logs: list[Any], step: float) -> list[float]:
    """Largest and mean difference from the package's rollouts, mrad; infinite if MuJoCo diverges."""
    from embodiedreamer_gym.engines.export.replay import agreement
    from embodiedreamer_gym.errors import SimulationError

    try:
        found = agreement(path, model, logs, step)
    except SimulationError:
        return [np.inf, np.inf]
    return [1e3 * float(found.largest.max()), 1e3 * float(found.mean.mean())]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--only", nargs="+", help="names of cases")
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    from embodiedreamer_gym.engines.export import export_model
    from embodiedreamer_gym.simulation.drive import TIME_STEP

    rows: list[dict[str, Any]] = []
    print(f"{'':<32}{'step':>8}{'largest':>9}{'mean':>8}{'fine':>8}   {'baseline':>8}{'mean':>8}   mrad")
    with tempfile.TemporaryDirectory() as folder:
        for name, model, logs in cases():
            if a.only and name not in a.only:
                continue
            written = export_model(model, Path(folder, "robot.xml"))
            largest, mean = gaps(written.path, model, logs, TIME_STEP)
            fine = gaps(written.path, model, logs, TIME_STEP / 16)
            plain = gaps(baseline(model, Path(folder, "plain.xml")), model, logs, TIME_STEP)
            target = TARGET_FRICTION if any(e.name in FRICTION for e in model.effects) else TARGET
            lost = [line.name for line in written.lost if "nothing is lost" not in line.text]
            verdict = f"not exported: {', '.join(lost)}" if lost else "" if largest <= target else f"above {target:g}"
            step = f"{1e3 * (written.timestep or 0):.2f} ms"
            print(
                f"{name:<32}{step:>8}{largest:>9.3f}{mean:>8.4f}{fine[0]:>8.3f}   {plain[0]:>8.1f}{plain[1]:>8.2f}   {verdict}",
                flush=True,
            )
            rows.append({"case": name, "timestep": written.timestep, "largest": largest, "mean": mean, "fine": fine, "baseline": plain,
                         "lost": lost, "target": target})  # fmt: skip
            save(rows, a.out)


if __name__ == "__main__":
    main()
