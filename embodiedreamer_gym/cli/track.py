"""`embodiedreamer track`."""

import sys
from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import joint_logs, load_model, readable
from embodiedreamer_gym.errors import EmbodieDreamerError

WITHOUT = ("--gain", "--seed", "--jobs", "--report")  # options that this verb does not use


@o.verb(
    o.option("trajectory", "TRAJECTORY", "desired joint positions: the positions of a log, or the commands of a csv"),
    o.MODEL,
    o.out_file("FILE.csv", "commands to send", "commands.csv"),
    *(one for one in o.LOGS if one.name not in WITHOUT),
)
def run(a, progress):
    """Write the commands under which a calibrated model follows a trajectory, with the expected error before and after."""
    from embodiedreamer_gym.diagnosis.comparison import gains_are_guessed
    from embodiedreamer_gym.tracking import track

    model = load_model(a, a.model)
    if gains_are_guessed(model):
        print("warning: the servo gains of the model are guessed, so that its commands will be wrong; calibrate it first",
              file=sys.stderr)  # fmt: skip
    progress("commands", 0)
    tracked = track(model, wanted(a, model))
    tracked.save(a.out, model.transmission)
    note = "" if model.transmission is None else " (of the motors, at the transmission's zeros)"
    text = f"{tracked}\n\ncommands: {a.out}{note}, within the joints' limits and speeds; try them slowly first"
    return o.Result(text, tracked.as_dict())


def wanted(a, model) -> Any:
    """The trajectory, as a recording whose positions are the desired ones."""
    if _commands_alone(Path(a.trajectory)):
        return readable(f"trajectory {a.trajectory}", lambda: _of_commands(a, model))
    logs = joint_logs(a, model, [a.trajectory])
    if len(logs) > 1:
        raise EmbodieDreamerError(f"{a.trajectory} holds {len(logs)} recordings; give one trajectory at a time.")
    return logs[0]


def _commands_alone(path: Path) -> bool:
    """Whether a file is a csv with commands but no positions."""
    if path.suffix != ".csv" or not path.is_file():
        return False
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        head = next((line for line in file if line.strip() and not line.startswith("#")), "")
    return ".command" in head and ".position" not in head


def _of_commands(a, model) -> Any:
    from embodiedreamer_gym.recordings import Recording
    from embodiedreamer_gym.recordings.plain_csv import read_commands
    from embodiedreamer_gym.robot.transmission import direct

    joints, time, command = read_commands(a.trajectory)
    between = model.transmission or direct(model.joints)
    path = Path(a.trajectory)
    log = Recording(path.stem, joints, time, command, source=str(path), command_hold=a.hold or "unknown")
    return between.to_joints(log.only(between.motors), model.joints).with_(units=model.units)
