"""Camera calibration: lens and pose of the virtual camera from frames of a robot and its joint angles."""

from embodiedreamer_gym.geometry.articulated_mesh import Body
from embodiedreamer_gym.vis_aligner.camera_calibration.calibrate import calibrate_camera, fit_keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Footage
from embodiedreamer_gym.vis_aligner.camera_calibration.keypoints import Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.result import CameraFit, StandFit
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View

__all__ = ["Body", "CameraFit", "Footage", "Keypoints", "StandFit", "View", "calibrate_camera", "fit_keypoints"]
