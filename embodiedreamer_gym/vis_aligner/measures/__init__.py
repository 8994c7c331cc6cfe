"""Measures of generated video, always beside the baselines that know nothing."""

from embodiedreamer_gym.vis_aligner.measures.baselines import copy_first, copy_last, raw_simulation
from embodiedreamer_gym.vis_aligner.measures.drift import drift_curve
from embodiedreamer_gym.vis_aligner.measures.evaluate import BASELINES, Measures, evaluate, evaluate_all
from embodiedreamer_gym.vis_aligner.measures.frechet import frechet_distance
from embodiedreamer_gym.vis_aligner.measures.likeness import (
    colour_shift,
    colour_shift_frames,
    gradient_psnr,
    psnr,
    psnr_frames,
    ssim,
    ssim_frames,
    temporal_error,
)
from embodiedreamer_gym.vis_aligner.measures.lpips import Lpips
from embodiedreamer_gym.vis_aligner.measures.regions import moving_region, static_background
from embodiedreamer_gym.vis_aligner.measures.segmenter import Segmenter, mask_iou
from embodiedreamer_gym.vis_aligner.measures.strip import strip
from embodiedreamer_gym.vis_aligner.measures.summary import Figure, Summary, summarise
from embodiedreamer_gym.vis_aligner.measures.tables import drift_table, table
from embodiedreamer_gym.vis_aligner.measures.truth import Truth
from embodiedreamer_gym.vis_aligner.measures.video_features import I3d, random_features

__all__ = [
    "BASELINES", "Figure", "I3d", "Lpips", "Measures", "Segmenter", "Summary", "Truth", "colour_shift",
    "colour_shift_frames", "copy_first", "copy_last", "drift_curve", "drift_table", "evaluate", "evaluate_all",
    "frechet_distance", "gradient_psnr", "mask_iou", "moving_region", "psnr", "psnr_frames", "random_features",
    "raw_simulation", "ssim", "ssim_frames", "static_background", "strip", "summarise", "table", "temporal_error",
]  # fmt: skip
