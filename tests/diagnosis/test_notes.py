"""What a diagnosis notes before its verdict."""

from __future__ import annotations

from embodiedreamer_gym.diagnosis.notes import notes_on
from tests.two_joint_arm import load_arm, record


def test_a_urdf_that_is_gone_is_no_error_at_the_end_of_a_diagnosis(tmp_path) -> None:
    arm = load_arm(tmp_path)
    log = record(arm).with_(nominal_time=True)
    (tmp_path / "two.urdf").unlink()
    (note,) = notes_on(arm, [log])
    assert "100 Hz, not measured" in note
