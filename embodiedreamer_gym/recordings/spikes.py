"""Spikes: single samples of a position that a faulty read of an encoder has put far from its neighbours."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import grey_closing, grey_opening

from embodiedreamer_gym.recordings.checks import Finding
from embodiedreamer_gym.recordings.noise import estimate_noise, estimate_quantum
from embodiedreamer_gym.recordings.recording import Recording

WINDOW = 3  # samples: a peak that is narrower, of one or two samples, may be a spike; steps and ramps are not peaks
FAR = 20.0  # times the height that all but 2 RARE of the samples stay below
RARE = 0.01  # largest share of samples
HIGHER = 3.0  # times the largest step between other neighbouring samples
LEAST = 0.01  # rad, m or share of the travel: less is not a spike


def without_spikes(recording: Recording) -> tuple[Recording, list[Finding]]:
    """The recording with its spikes cut off and marked unusable, and the findings.

    Noise and resolution of these joints are estimated again without the spikes.

    If more than a share RARE of a joint's samples are narrow peaks, they are not spikes. Peaks are found by opening
    and closing: Serra, Image Analysis and Mathematical Morphology, 1982.
    """
    x = recording.position
    if len(x) <= 2 * WINDOW:
        return recording, []
    without_peaks = grey_opening(x, size=(WINDOW, 1), mode="nearest")
    smooth = grey_closing(without_peaks, size=(WINDOW, 1), mode="nearest")
    height = np.abs(x - smooth)
    found = height > np.maximum(FAR * np.quantile(height, 1.0 - 2.0 * RARE, axis=0), LEAST)
    beside = found[1:] | found[:-1]
    steps = np.max(np.where(beside, 0.0, np.abs(np.diff(x, axis=0))), axis=0)  # of the motion, from sample to sample
    found &= (height > HIGHER * steps) & (found.mean(axis=0) <= RARE)
    findings = []
    for j in np.flatnonzero(found.any(axis=0)):
        joint, rows = recording.joints[j], np.flatnonzero(found[:, j])
        first = recording.time[rows[0]] - recording.time[0]
        more = f" and at {len(rows) - 1} more samples" if len(rows) > 1 else ""
        message = (
            f"{joint} jumps to {x[rows[0], j]:.4g} and back at {first:.3f} s (sample {rows[0]}){more}: a faulty reading; "
            "the samples are left out"
        )
        findings.append(Finding("warning", "spike", (joint,), message))
    if not findings:
        return recording, []
    mended, noise, quantum = np.where(found, smooth, x), recording.noise.copy(), recording.quantum.copy()
    for j in np.flatnonzero(found.any(axis=0)):
        quantum[j] = estimate_quantum(mended[:, j])
        noise[j] = estimate_noise(recording.time, mended[:, j], quantum[j])
    usable = recording.usable & ~found
    return recording.with_(position=mended, usable=usable, noise=noise, quantum=quantum), findings
