"""Recorded episodes with generated frames of a blue cup and a sheet of paper, as further training data. (half a minute)"""

from __future__ import annotations

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
from embodiedreamer_gym.pipelines.regenerate import regenerate
from embodiedreamer_gym.recordings.episodes import mixed
from embodiedreamer_gym.vis_aligner.editing import Chain, PaperSheet, Recolour


def main() -> None:
    record_demonstrations(Demonstrations("GrabPaperCup"), 1, "demos")
    regenerate("demos", "original")  # embodiedreamer augment --data demos --out original
    edit = Chain([PaperSheet(CAMERAS["head"]), Recolour(("cup",), colour=(40, 70, 220))])
    found = regenerate("demos", "changed", editor=edit, copies=2)  # ... --edit paper recolour:cup --copies 2
    print(f"{found.written} new episodes; of {len(found.failed)} the replay failed")
    episodes = mixed("original", "changed")  # embodiedreamer policy train --data original changed ...
    print(episodes)
    print("states as recorded:", bool((episodes.states(0) == episodes.states(2)).all()))


if __name__ == "__main__":
    main()
