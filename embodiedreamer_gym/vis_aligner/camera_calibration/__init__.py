"""Camera calibration: intrinsics and poses of a camera from frames of a robot and its joint angles, without a target."""

from embodiedreamer_gym.geometry.articulated_mesh import Body
from embodiedreamer_gym.io.deprecation import deprecated_names
from embodiedreamer_gym.vis_aligner.camera_calibration.calibrate import calibrate_camera, fit_keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Footage
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.result import CameraFit, StationFit
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

__getattr__ = deprecated_names(__name__, {"StandFit": "StationFit"})

__all__ = ["Body", "CameraFit", "Footage", "Keypoints", "StationFit", "View", "calibrate_camera", "fit_keypoints"]
