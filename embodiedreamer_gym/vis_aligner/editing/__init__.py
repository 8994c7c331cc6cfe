"""Edits of a reference picture, from which the video model generates an episode with another appearance."""

from embodiedreamer_gym.vis_aligner.editing.background import Background
from embodiedreamer_gym.vis_aligner.editing.editor import Chain, ReferenceEditor, apply, describe, draws_of
from embodiedreamer_gym.vis_aligner.editing.inpaint import Inpaint
from embodiedreamer_gym.vis_aligner.editing.paper import PaperSheet
from embodiedreamer_gym.vis_aligner.editing.recolour import Recolour
from embodiedreamer_gym.vis_aligner.editing.references import edited, masks_of

__all__ = [
    "Background",
    "Chain",
    "Inpaint",
    "PaperSheet",
    "Recolour",
    "ReferenceEditor",
    "apply",
    "describe",
    "draws_of",
    "edited",
    "masks_of",
]
