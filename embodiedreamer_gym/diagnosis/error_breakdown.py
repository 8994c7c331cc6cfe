"""error_breakdown: a model's error by joint and regime, its correlations, and whether controller or plant is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.diagnosis.compare import compare
from embodiedreamer_gym.diagnosis.comparison import GUESSED, Comparison
from embodiedreamer_gym.diagnosis.error_attribution import controller_share, lags
from embodiedreamer_gym.diagnosis.regimes import REGIME_HEADS, REGIMES
from embodiedreamer_gym.io.tables import finite, layout, milli, number
from embodiedreamer_gym.recordings import Recording, smooth_motion
from embodiedreamer_gym.robot import RobotModel

BINS = 12
FEWEST = 10  # least number of samples in a bin
QUANTITIES = ("speed", "angle", "torque", "time")
CORRELATES = {
    "speed": "correlates with speed and its direction",
    "angle": "correlates with the joint's angle",
    "torque": "correlates with the torque on the joint",
    "time": "drifts with time",
}
WHEN = {
    "hold": "while the joint holds still",
    "slow": "in slow motion",
    "fast": "in fast motion",
    "reversal": "around reversals",
    "accelerating": "while it accelerates",
    "loaded": "under load",
}
VISIBLE = 2.0  # chi2/n above which a joint's error is more than noise
STRONG = 0.4  # share of the error's variance that a quantity must explain to be named
CONSTANT_SHARE = 0.8  # share of a joint's error that must be its mean to call it a constant offset
MORE = 1.3  # multiple of the joint's total error above which a regime is reported
ENOUGH = 30  # least number of samples of a regime that is reported
READABLE = 6  # most joints listed in a sentence
SHORTEST_LAG = 5.0  # ms; shorter lags are below what the smoothing resolves


@dataclass(frozen=True, eq=False)
class Profile:
    """One joint's position error binned against a quantity: arrays (bins,) in the joint's unit.

    centre: of the bin, in unit/s, unit, N m or s; median, low, high: of the error (low, high: 16th and 84th
    percentile);
    share: share of the error's variance that the bin means explain (against time: that a straight line explains).
    """

    joint: str
    against: str
    centre: np.ndarray
    median: np.ndarray
    low: np.ndarray
    high: np.ndarray
    share: float

    def as_dict(self) -> dict[str, Any]:
        """The profile as JSON."""
        arrays = {key: getattr(self, key).tolist() for key in ("centre", "median", "low", "high")}
        return {"joint": self.joint, "against": self.against, "share": self.share, **arrays}


@dataclass(frozen=True, eq=False, repr=False)
class ErrorBreakdown:
    """Breakdown of one model's error.

    comparison: the model's errors, see `compare`.
    controller_share: (n,), see `controller_share`, nan if unknown.
    side: the same for the whole robot, weighted by each joint's error, None if unknown.
    lag_ms: (n,), lag of the measured motion behind the simulated motion, nan if unknown.
    profiles: error against speed, angle, torque and time.
    findings: one sentence each.
    """

    comparison: Comparison
    controller_share: np.ndarray
    side: float | None
    lag_ms: np.ndarray
    profiles: tuple[Profile, ...]
    findings: tuple[str, ...]

    def __repr__(self) -> str:
        return f"ErrorBreakdown({self.comparison.labels[0]!r}, n={len(self.lag_ms)}, {len(self.findings)} findings)"

    @property
    def chi2(self) -> np.ndarray:
        """Heat map (n, 7) of chi2/n by joint and regime, "all" first; nan where there is no sample."""
        return self.comparison.grid()

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON, with units."""
        names, joints = ("all", *REGIMES), self.comparison.joints
        rows = zip(joints, self.chi2, strict=True)
        return {
            "findings": list(self.findings),
            "chi2": {j: {k: finite(v) for k, v in zip(names, row, strict=True)} for j, row in rows},
            "controller_share": {
                "all": self.side,
                **{j: finite(v) for j, v in zip(joints, self.controller_share, strict=True)},
            },
            "lag": {"unit": "ms", **{j: finite(v) for j, v in zip(joints, self.lag_ms, strict=True)}},
            "profiles": [profile.as_dict() for profile in self.profiles],
            "comparison": self.comparison.as_dict(),
        }

    def __str__(self) -> str:
        rows = []
        for j, joint in enumerate(self.comparison.joints):
            share = self.controller_share[j]
            side = f"{share:.0%} / {1 - share:.0%}" if np.isfinite(share) else "-"
            lag = f"{self.lag_ms[j]:+.0f}" if np.isfinite(self.lag_ms[j]) else "-"
            rows.append([joint, *(number(v) for v in self.chi2[j]), lag, side])
        label = self.comparison.labels[0]
        note = f"; {GUESSED}" if self.comparison.gains_guessed else ""
        title = f"chi2/n of {label} by regime (1 = sensor noise{note})"
        heads = ["joint", *REGIME_HEADS, "late ms", "ctrl/plant"]
        return "\n".join([title, layout(heads, rows), "", *self.findings])


def error_breakdown(model: RobotModel, recordings: Sequence[Recording]) -> ErrorBreakdown:
    """Break a model's error down by joint, regime and side (controller or plant); no missing effect is named.

    Raises: SimulationError when a recording is not of this robot, RecordingError when there is none.
    """
    comparison = compare(model, recordings)
    share = controller_share(model, comparison.recordings, comparison.rollouts[0])
    profiles = tuple(_profiles(comparison))
    lag = lags(comparison.recordings, comparison.rollouts[0])
    weight = np.where(np.isfinite(share), np.maximum(comparison.joint_chi2[0] - 1.0, 0.0), 0.0)
    counted = np.isfinite(share) & (weight > 0)
    side = float(np.average(share[counted], weights=weight[counted])) if counted.any() else None
    findings = tuple(_findings(comparison, side, lag, profiles))
    return ErrorBreakdown(comparison, share, side, lag, profiles, findings)


def _profiles(comparison: Comparison) -> Iterator[Profile]:
    pairs = list(zip(comparison.recordings, comparison.rollouts[0], strict=True))
    motions, errors = [smooth_motion(r) for r in comparison.recordings], comparison.errors(0)
    values = {
        "speed": [m.velocity for m in motions],
        "angle": [m.position for m in motions],
        "torque": [run.torque for _, run in pairs],
        "time": [np.repeat((r.time - r.time[0])[:, None], len(r.joints), axis=1) for r, _ in pairs],
    }
    for j, joint in enumerate(comparison.joints):
        usable = [u[:, j] for u in comparison.signals.usable]
        error = np.concatenate([e[u, j] for e, u in zip(errors, usable, strict=True)])
        for against in QUANTITIES:
            x = np.concatenate([v[u, j] for v, u in zip(values[against], usable, strict=True)])
            if len(x) >= FEWEST:
                yield _profile(joint, against, x, error)


def _profile(joint: str, against: str, x: np.ndarray, error: np.ndarray) -> Profile:
    low, high = np.percentile(x, [1, 99])
    place = np.clip(((x - low) / max(high - low, 1e-12) * BINS).astype(int), 0, BINS - 1)
    bins = [(np.median(x[place == b]), error[place == b]) for b in range(BINS) if (place == b).sum() >= FEWEST]
    total = float(np.var(error))
    between = sum(len(e) * (e.mean() - error.mean()) ** 2 for _, e in bins) / len(error)
    if against == "time":  # bins follow any slow change; a drift is a trend
        between = total * np.corrcoef(x, error)[0, 1] ** 2 if total > 0 and np.ptp(x) > 0 else 0.0
    quantiles = np.array([np.percentile(e, [50, 16, 84]) for _, e in bins]).reshape(-1, 3).T
    centre = np.array([c for c, _ in bins])
    return Profile(joint, against, centre, *quantiles, share=float(between / total) if total > 0 else 0.0)


def _findings(
    comparison: Comparison, side: float | None, lag: np.ndarray, profiles: Sequence[Profile]
) -> Iterator[str]:
    """Sentences: which joints, in which regime, with which lag, what the error correlates with, on which side."""
    chi2 = comparison.joint_chi2[0]
    bad = [j for j in range(len(chi2)) if chi2[j] > VISIBLE]
    if not bad:
        yield "Every joint is at its noise floor: these recordings show no error."
        return
    quiet = [comparison.joints[j] for j in range(len(chi2)) if chi2[j] <= VISIBLE]
    worst = max(bad, key=lambda j: chi2[j])
    size = milli(comparison.joint_rms[0, worst], comparison.units[worst])
    times = number(np.sqrt(chi2[worst]))
    yield f"{_joints(comparison, bad)}: the error is more than sensor noise."
    yield f"Joint {comparison.joints[worst]} is worst: {size}, {times} times its noise."
    if quiet:
        yield f"{_list(quiet)}: at the noise floor."
    yield from _regime_sentences(comparison, bad)
    yield from _lag_sentences(comparison, bad, lag)
    yield from _offset_sentences(comparison, bad)
    yield from _profile_sentences(comparison, bad, profiles)
    if side is not None:
        name, part = ("controller", side) if side >= 0.5 else ("plant", 1 - side)
        between = "command and effort" if side >= 0.5 else "effort and motion"
        yield f"{part:.0%} of the effort's unexplained part is on the {name} side, between {between}."


def _regime_sentences(comparison: Comparison, bad: Sequence[int]) -> Iterator[str]:
    rms, samples = comparison.grid(value="rms"), comparison.grid(value="samples")
    enough = samples[:, 1:] >= ENOUGH
    ratio = np.where(enough, rms[:, 1:] / rms[:, :1], 0.0)
    for k, regime in enumerate(REGIMES):
        joints = [j for j in bad if int(np.argmax(ratio[j])) == k and ratio[j, k] > MORE]
        if joints:
            most = f"up to {max(ratio[j, k] for j in joints):.1f} times the usual"
            yield f"{_joints(comparison, joints)}: the error is largest {WHEN[regime]} ({most})."


def _lag_sentences(comparison: Comparison, bad: Sequence[int], lag: np.ndarray) -> Iterator[str]:
    for word, sign in (("later", 1), ("earlier", -1)):
        joints = [j for j in bad if sign * lag[j] > SHORTEST_LAG]
        if joints:
            low, high = (f"{f(abs(lag[j]) for j in joints):.0f}" for f in (min, max))
            time = f"{low} ms" if low == high else f"{low} to {high} ms"
            yield f"{_joints(comparison, joints)}: the measured motion is {time} {word} than the simulated."


def _offset_sentences(comparison: Comparison, bad: Sequence[int]) -> Iterator[str]:
    """Joints whose error is a constant offset."""
    usable = comparison.signals.usable
    sums = np.sum([(e * u).sum(axis=0) for e, u in zip(comparison.errors(0), usable, strict=True)], axis=0)
    mean = sums / np.maximum(np.sum([u.sum(axis=0) for u in usable], axis=0), 1)
    joints = [j for j in bad if abs(mean[j]) > CONSTANT_SHARE * comparison.joint_rms[0, j]]
    if joints:
        sizes = ", ".join(milli(mean[j], comparison.units[j]) for j in joints)
        yield f"{_joints(comparison, joints)}: the measured position differs from the simulated by a constant {sizes}."


def _profile_sentences(comparison: Comparison, bad: Sequence[int], profiles: Sequence[Profile]) -> Iterator[str]:
    """The quantity that each joint's error correlates with most."""
    best: dict[str, Profile] = {}
    for profile in profiles:
        if profile.share > max(STRONG, best[profile.joint].share if profile.joint in best else 0.0):
            best[profile.joint] = profile
    for quantity in QUANTITIES:
        joints = [j for j in bad if (p := best.get(comparison.joints[j])) and p.against == quantity]
        if joints:
            most = max(best[comparison.joints[j]].share for j in joints)
            yield f"{_joints(comparison, joints)}: the error {CORRELATES[quantity]} (up to {most:.0%} of its variance)."


def _joints(comparison: Comparison, columns: Sequence[int]) -> str:
    names = [comparison.joints[j] for j in columns]
    return f"All {len(names)} joints" if len(names) == len(comparison.joints) > 2 else _list(names)


def _list(names: Sequence[str]) -> str:
    """Names as the beginning of a sentence; if there are many, only the first and the last."""
    if len(names) > READABLE:
        return f"{len(names)} joints ({names[0]} … {names[-1]})"
    return f"Joint {names[0]}" if len(names) == 1 else f"Joints {', '.join(names)}"
