"""Draw docs/images/vis/augmentation.jpg, one episode before edited benches: python docs/make_augmentation.py."""

from __future__ import annotations

import tempfile
from pathlib import Path

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
from embodiedreamer_gym.pipelines.regenerate import regenerate
from embodiedreamer_gym.recordings.episodes import open_episodes
from embodiedreamer_gym.vis_aligner import metrics
from embodiedreamer_gym.vis_aligner.editing import Background, Chain, PaperSheet, Recolour

OUT = Path(__file__).parent / "images" / "vis" / "augmentation.jpg"
BLUE = Recolour(("cup",), colour=(40, 70, 220))
EDITS = {
    "generated": None, "blue cup": BLUE, "sheet of A4": PaperSheet(CAMERAS["head"], pose=(0.58, 0.0, 0.4)),
    "background": Background(), "all": Chain([Background(("table",)), PaperSheet(CAMERAS["head"]), Recolour()]),
}  # fmt: skip


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        demos, rows = Path(folder) / "demos", {}
        record_demonstrations(Demonstrations("PutCupOnMat", seed=1), 1, demos)
        rows["simulated"] = open_episodes(demos).frames(0, "head")
        for name, editor in EDITS.items():
            regenerate(demos, Path(folder) / name, editor=editor, seed=1)
            rows[name] = open_episodes(Path(folder) / name).frames(0, "head")
        save_picture(metrics.strip(rows, columns=6), OUT)
