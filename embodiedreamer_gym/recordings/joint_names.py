"""Find the requested joints of a log by name."""

from __future__ import annotations

from collections.abc import Sequence

from embodiedreamer_gym.errors import RecordingError


def find_joints(have: Sequence[str], wanted: Sequence[str], source: str) -> tuple[list[int], tuple[str, ...]]:
    """Columns of the requested joints in a log, and a note about the joints that are left out.

    A name matches itself, or the only name of the log that ends with it: `elbow` matches `main_elbow` or `arm/elbow`.
    Raises: RecordingError for a joint that the log does not have.
    """
    columns, missing = [], []
    for joint in wanted:
        found = [k for k, name in enumerate(have) if name == joint]
        found = found or [k for k, name in enumerate(have) if name.endswith(("_" + joint, "/" + joint, "." + joint))]
        missing += [] if len(found) == 1 else [joint]
        columns += found[:1]
    if missing or not wanted:
        raise RecordingError(
            f"{source}: asked for {', '.join(missing) or 'no joint at all'}; it has the joints {', '.join(have)}; "
            "remove from the model's `joints` what the log does not have, or use the names of the log there"
        )
    rest = [name for k, name in enumerate(have) if k not in columns]
    note = (
        f"{', '.join(rest)} of the log "
        f"{'is not a joint of the model and was' if len(rest) == 1 else 'are not joints of the model and were'} "
        "left out"
    )
    return columns, (note,) if rest else ()
