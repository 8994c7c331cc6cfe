"""`embodiedreamer vis carve`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli import vis_inputs as i
from embodiedreamer_gym.errors import EmbodieDreamerError


@o.verb(
    o.RECORDINGS,
    o.option("--model", "M", i.URDF, o.REQUIRED),
    i.JOINTS,
    i.CAMERAS,
    i.CAMERA,
    o.option("--link", "NAME", "link that the missing shape moves with", o.REQUIRED),
    o.option("--reach", "M", "largest distance of the shape along each axis of the link, m", 0.2, o.number(float, 0.05, 0.5)),
    o.HZ,
    o.out_file("FILE.json", "robot model with the carved shape"),
    o.QUIET,
)  # fmt: skip
def run(a, progress):
    """Add the shape of a hand or tool that the URDF lacks to a robot model, from recordings with video."""
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.robot.carved_urdf import add_visual
    from embodiedreamer_gym.robot.surface import Surface
    from embodiedreamer_gym.vis_aligner.camera_calibration import Footage
    from embodiedreamer_gym.vis_aligner.camera_calibration.inputs import camera_name
    from embodiedreamer_gym.vis_aligner.carving import carve

    if a.out.suffix != ".json":
        raise EmbodieDreamerError(f"{a.out} cannot be written; give a file name.json.")
    model = i.robot_model(a)
    surface = Surface.of_model(model, skeleton=True)
    cameras = i.load_camera_file(a)
    footage, places = [], []
    logs = load_recordings(*a.recordings, hz=a.hz, joints=model.joints)
    for number, log in enumerate(logs):
        name = camera_name(a.camera, log)
        poses = surface.link_poses(a.link, log.only(model.joints).position)
        footage.append(Footage(log.frames[name], poses[:, None], name=log.name))
        places.append(i.camera_of(cameras, name, log.name))
        progress("recordings read", number + 1, len(logs))
    shape = carve(footage, places, a.reach)
    urdf = a.out.with_name(f"{a.out.stem}_carved.urdf")
    add_visual(model.urdf, a.link, shape.vertices, shape.faces, (shape.colour / 255).tolist(), urdf)
    model.with_(urdf=urdf).save(a.out)
    return f"{a.out}: {shape!r} of {a.link}, in {urdf}"
