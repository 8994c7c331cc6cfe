"""Metrics of generated video, always reported with baselines that need no model."""

from embodiedreamer_gym.io.deprecation import deprecated_names
from embodiedreamer_gym.vis_aligner.metrics.baselines import copy_first, copy_last, raw_simulation
from embodiedreamer_gym.vis_aligner.metrics.drift import drift_curve
from embodiedreamer_gym.vis_aligner.metrics.evaluate import BASELINES, Measures, evaluate, evaluate_all
from embodiedreamer_gym.vis_aligner.metrics.filmstrip import strip
from embodiedreamer_gym.vis_aligner.metrics.frechet import frechet_distance
from embodiedreamer_gym.vis_aligner.metrics.ground_truth import GroundTruth
from embodiedreamer_gym.vis_aligner.metrics.image_metrics import (
    colour_shift,
    colour_shift_frames,
    gradient_psnr,
    psnr,
    psnr_frames,
    ssim,
    ssim_frames,
    temporal_error,
)
from embodiedreamer_gym.vis_aligner.metrics.lpips import Lpips
from embodiedreamer_gym.vis_aligner.metrics.regions import moving_region, static_background, unclassed_region
from embodiedreamer_gym.vis_aligner.metrics.segmenter import Segmenter, mask_iou
from embodiedreamer_gym.vis_aligner.metrics.summary import Figure, Summary, summarise
from embodiedreamer_gym.vis_aligner.metrics.tables import drift_table, table
from embodiedreamer_gym.vis_aligner.metrics.video_features import I3d, random_features

__all__ = [
    "BASELINES", "Figure", "GroundTruth", "I3d", "Lpips", "Measures", "Segmenter", "Summary", "colour_shift",
    "colour_shift_frames", "copy_first", "copy_last", "drift_curve", "drift_table", "evaluate", "evaluate_all",
    "frechet_distance", "gradient_psnr", "mask_iou", "moving_region", "psnr", "psnr_frames", "random_features",
    "raw_simulation", "ssim", "ssim_frames", "static_background", "strip", "summarise", "table", "temporal_error",
    "unclassed_region",
]  # fmt: skip

__getattr__ = deprecated_names(
    __name__, {"Truth": "GroundTruth", "likeness": "embodiedreamer_gym.vis_aligner.metrics.image_metrics"}
)
