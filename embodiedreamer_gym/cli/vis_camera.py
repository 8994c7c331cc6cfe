"""`embodiedreamer vis camera`."""

from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli import vis_inputs as i


@o.verb(
    o.RECORDINGS,
    o.option("--model", "M", i.URDF, o.REQUIRED),
    i.JOINTS,
    i.CAMERA,
    o.option("--video", "FILE", "video of each recording that has no frames", None, Path, nargs="+"),
    o.option("--masks", "DIR", "masks of the robot: DIR/RECORDING/*.png, one per frame", None, Path),
    o.option("--start", "FILE.json", "camera file with a first guess", None, Path),
    o.option("--marks", "FILE.json", "points of the robot that were marked in frames", None, Path),
    o.option("--fixed", None, "the camera has the same pose in all recordings"),
    o.option("--free", "A,B", "parameters to fit: focal, aspect, cx, cy, k1, delay", "focal,aspect"),
    o.option("--loose", "A,B", "links that look different from the model", ""),
    o.option("--margin", "M", "width of the ignored margin around these links, m", 0.06, o.number(float, 0.0, 10.0)),
    o.HZ,
    o.SEED,
    o.out_file("FILE.json", "camera file"),
    o.option("--overlay", "DIR", "write images with the robot's outline over the frames", None, o.output_folder),
    o.JSON,
    o.QUIET,
)
def run(a, progress):
    """Fit intrinsics and pose of a real camera to recordings of the robot in its view."""
    from embodiedreamer_gym.envs.cameras import load_cameras, save_cameras
    from embodiedreamer_gym.io.video import save_picture
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.robot.surface import Surface
    from embodiedreamer_gym.vis_aligner.camera_calibration import calibrate_camera
    from embodiedreamer_gym.vis_aligner.camera_calibration.inputs import (
        GIVE_VIDEO,
        camera_name,
        first_guess,
        read_footage,
        read_marks,
    )
    from embodiedreamer_gym.vis_aligner.camera_calibration.overlay import overlay

    surface = _surface(a, Surface)
    logs = list(load_recordings(*a.recordings, hz=a.hz, joints=surface.joints))
    footage = read_footage(logs, surface, a.camera, a.video, a.masks)
    marks = None if a.marks is None else read_marks(a.marks, logs, surface, a.fixed)
    start = None if a.start is None else first_guess(load_cameras(a.start), a.start)
    name = a.camera or ("camera" if a.video else camera_name(None, logs[0], GIVE_VIDEO))
    fit = calibrate_camera(
        surface.body, footage, start=start, marks=marks, fixed=a.fixed, free=i.listed(a.free),
        loose=i.listed(a.loose), margin=a.margin, name=name, seed=a.seed, report=progress,
    )  # fmt: skip
    save_cameras(fit.cameras, a.out)
    text = str(fit)
    if a.overlay is not None:
        a.overlay.mkdir(parents=True, exist_ok=True)
        for k, one in enumerate(footage):
            view = fit.views()[0 if a.fixed else k]
            save_picture(overlay(surface.body, one, view, delay=fit.delay), a.overlay / f"{one.name}.png")
        text += f"\n\npictures: {a.overlay}; green must lie on the robot's edge"
    return o.Result(text, fit.as_dict())


def _surface(a, surface: Any) -> Any:
    from embodiedreamer_gym.robot import RobotModel

    joints = i.joints_of_urdf(a)
    return surface.of_model(RobotModel.load(a.model)) if joints is None else surface(a.model, joints)
