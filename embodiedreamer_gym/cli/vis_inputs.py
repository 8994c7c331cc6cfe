"""Options shared by the verbs that use recordings with video: the robot and the cameras."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.errors import EmbodieDreamerError

URDF = f"{o.MODELS}, or a .urdf with --joints"
JOINTS = o.option("--joints", "A,B", "joint names in the logs, if the model is a .urdf")
CAMERAS = o.option("--cameras", "FILE", "calibrated cameras (default: the built-in ones)", None, Path)
CAMERA = o.option("--camera", "NAME", "camera of the recordings (default: the only one)")


def listed(text: str) -> tuple[str, ...]:
    """Names from a comma-separated text."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def joints_of_urdf(a) -> tuple[str, ...] | None:
    """Joints of a model given as a URDF; None for any other model.

    Raises: EmbodieDreamerError for a URDF without joints, or joints without a URDF.
    """
    if not a.model.endswith(".urdf"):
        if a.joints:
            raise EmbodieDreamerError("--joints is only for a .urdf; a model file already names its joints.")
        return None
    if not a.joints:
        raise EmbodieDreamerError(f"{a.model} is a URDF; name the logs' columns with --joints a,b,c.")
    return listed(a.joints)


def robot_model(a) -> Any:
    """The robot model that the options name: a model file, a built-in robot or a URDF."""
    from embodiedreamer_gym.robot import RobotModel

    joints = joints_of_urdf(a)
    return RobotModel.load(a.model) if joints is None else RobotModel.of_urdf(a.model, joints)


def load_camera_file(a) -> Mapping[str, Any]:
    """The cameras of the file that the options name, or the built-in ones.

    Raises: EmbodieDreamerError where no camera has the name that the options give.
    """
    from embodiedreamer_gym.envs.cameras import CAMERAS as BUILT_IN
    from embodiedreamer_gym.envs.cameras import load_cameras

    cameras = BUILT_IN if a.cameras is None else load_cameras(a.cameras)
    if a.camera is not None and not any(name.partition("/")[0] == a.camera or name == a.camera for name in cameras):
        raise EmbodieDreamerError(f"no camera is named '{a.camera}'; give one of {', '.join(cameras)}.")
    return cameras


def camera_of(cameras: Mapping[str, Any], name: str, recording: str) -> Any:
    """The camera of a recording, stored as NAME/RECORDING (by `vis camera` without --fixed) or as NAME.

    Raises: EmbodieDreamerError where there is none.
    """
    for key in (f"{name}/{recording}", name):
        if key in cameras:
            return cameras[key].with_(name=name)
    raise EmbodieDreamerError(
        f"no camera is named '{name}' or '{name}/{recording}'; there are {', '.join(cameras)}. A camera that was "
        "moved between recordings is calibrated only for the recordings that were given to `vis camera`."
    )
