"""Preflight: checks of a recording before a fit uses it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.recordings import checks, contact
from embodiedreamer_gym.recordings.checks import SEVERITIES, Finding
from embodiedreamer_gym.recordings.recording import Recording
from embodiedreamer_gym.recordings.spikes import without_spikes
from embodiedreamer_gym.recordings.tracking import runs, track

FOLLOWS = 0.5  # correlation with its command above which a joint follows it


@dataclass(frozen=True, eq=False, repr=False)
class Preflight:
    """Findings about a recording, errors first, and the recording with the bad samples marked unusable.

    excluded: joint -> number of samples that a fit will not use, including those marked before.
    """

    recording: Recording
    findings: tuple[Finding, ...]
    excluded: Mapping[str, int]

    @property
    def ok(self) -> bool:
        """Whether no finding is an error."""
        return all(finding.severity != "error" for finding in self.findings)

    def __repr__(self) -> str:
        counts = [f"{sum(f.severity == s for f in self.findings)} {s}" for s in SEVERITIES]
        return f"Preflight({self.recording.name!r}: {', '.join(counts)}, {sum(self.excluded.values())} excluded)"

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """The findings and the excluded samples as text, one line each."""
        lines = [repr(self.recording)]
        lines += [f"  {f.severity:<8}{f.code:<16}{f.message}" for f in self.findings] or ["  no findings"]
        total = len(self.recording.time)
        lines += [
            f"  excluded {joint}: {count} of {total} samples ({count / total:.0%})"
            for joint, count in self.excluded.items()
            if count
        ]
        return "\n".join(lines)


def preflight_all(
    recordings: Sequence[Recording], limits: Mapping[str, tuple[float, float]] | None = None
) -> list[Preflight]:
    """Check the recordings of one robot.

    A joint that moves against its command in one recording but follows it in another does not have the wrong sign; it
    may be too weak for its load. The finding is then a warning, not an error.
    limits: see `preflight`.
    """
    checked = [preflight(recording, limits) for recording in recordings]
    follows: set[str] = set()
    for recording in (one.recording for one in checked):
        if recording.command is not None:
            agrees = checks.following(recording, track(recording, recording.command)) > FOLLOWS
            follows |= {joint for joint, yes in zip(recording.joints, agrees, strict=True) if yes}
    return [replace(one, findings=_mended(one.findings, follows)) for one in checked]


def _mended(findings: Sequence[Finding], follows: set[str]) -> tuple[Finding, ...]:
    """Findings, with wrong signs turned into warnings for joints that follow their command in another recording."""
    changed = []
    for finding in findings:
        if finding.code == "sign-flipped" and finding.joints[0] in follows:
            joint = finding.joints[0]
            message = f"{joint} moves against its command here and follows it in another recording: its torque may be too small for its load"
            finding = Finding("warning", "moves-against", (joint,), message)
        changed.append(finding)
    return tuple(sorted(changed, key=lambda finding: SEVERITIES.index(finding.severity)))


def preflight(recording: Recording, limits: Mapping[str, tuple[float, float]] | None = None) -> Preflight:
    """Check a recording and mark the samples a fit of the free arm must not use.

    limits: joint -> (lower, upper) in the joint's unit; a joint may be left out.
    """
    limits = dict(limits or {})
    recording, spikes = without_spikes(recording)
    findings = [*spikes, *(Finding("info", "converted", (), note) for note in recording.notes)]
    findings += [*checks.time_base(recording), *checks.channels(recording)]
    bad = ~recording.usable
    if recording.command is not None:
        tracking = track(recording, recording.command)
        more, mixed = checks.mixed_up(recording, tracking)
        wrong, columns = checks.units(recording, tracking, limits)
        more, mixed = [*more, *wrong], mixed | columns
        stuck, off = checks.frozen(recording, tracking, mixed)
        mixed |= set(np.flatnonzero(off.any(axis=0)).tolist())
        ends, pinned = checks.clipped(recording, tracking, limits)
        grip = contact.held(recording, tracking, limits)
        push = contact.pushed(recording, tracking, recording.command)
        pinned[:, [*mixed]] = False
        ends = [finding for finding in ends if pinned[:, recording.joints.index(finding.joints[0])].any()]
        mixed |= set(np.flatnonzero(pinned.any(axis=0)).tolist())  # a pinned joint is off its command too
        findings += [*more, *stuck, *ends, *checks.offset(recording, tracking, mixed)]
        findings += _touches(recording, grip, "held", "holds an object")
        findings += _touches(recording, push, "pushed", "is moved from outside while it should stand still")
        for j in range(len(recording.joints)):
            bad[:, j] |= off[:, j] | contact.widened(recording, pinned[:, j])
        bad |= contact.whole_arm(recording, grip | push)
    findings.sort(key=lambda finding: SEVERITIES.index(finding.severity))
    excluded = dict(zip(recording.joints, bad.sum(axis=0).tolist(), strict=True))
    return Preflight(recording.with_(usable=~bad), tuple(findings), excluded)


def _touches(recording: Recording, mask: np.ndarray, code: str, what: str) -> list[Finding]:
    """One finding for each joint of a contact mask (T, n)."""
    findings = []
    for j in np.flatnonzero(mask.any(axis=0)):
        joint, stretches = recording.joints[j], list(runs(mask[:, j]))
        first = recording.time[stretches[0].start] - recording.time[0]
        last = recording.time[stretches[-1].stop - 1] - recording.time[0]
        message = (
            f"{joint} {what}, {len(stretches)} times from {first:.2f} s to {last:.2f} s; the samples of its arm "
            "are left out during these times"
        )
        findings.append(Finding("warning", code, (joint,), message))
    return findings
