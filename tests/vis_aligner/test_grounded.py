"""Masks from words: the real classes of both models, tiny and untrained, from local folders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.vis_aligner import grounded as module
from embodiedreamer_gym.vis_aligner.grounded import grounded

WORDS = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "red", "blue", "cup", "mat")
FRAME = np.random.default_rng(0).integers(0, 255, (96, 128, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    t = pytest.importorskip("transformers", reason="masks from words need transformers")
    torch.manual_seed(0)
    small = {"hidden_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2, "intermediate_size": 64}
    swin = t.SwinConfig(
        image_size=64, embed_dim=16, depths=[1, 1, 1], num_heads=[1, 2, 4], window_size=4,
        out_features=["stage2", "stage3"],
    )  # fmt: skip
    detector = t.GroundingDinoForObjectDetection(t.GroundingDinoConfig(
        backbone_config=swin, text_config=t.BertConfig(vocab_size=len(WORDS), **small), num_queries=20,
        encoder_layers=1, decoder_layers=2, d_model=32, encoder_ffn_dim=64, decoder_ffn_dim=64,
        encoder_attention_heads=2, decoder_attention_heads=2, num_feature_levels=3, max_text_len=16,
        disable_custom_kernels=True,
    ))  # fmt: skip
    segmenter = t.SamModel(t.SamConfig(
        vision_config=t.SamVisionConfig(hidden_size=16, output_channels=16, num_hidden_layers=1, num_attention_heads=2,
                                        image_size=64, patch_size=8, mlp_dim=32, window_size=4,
                                        global_attn_indexes=[0], num_pos_feats=8),
        prompt_encoder_config=t.SamPromptEncoderConfig(hidden_size=16, image_size=64, patch_size=8,
                                                       mask_input_channels=4),
        mask_decoder_config=t.SamMaskDecoderConfig(hidden_size=16, num_hidden_layers=1, num_attention_heads=2,
                                                   mlp_dim=32, iou_head_hidden_dim=16),
    ))  # fmt: skip
    sizes = {"pad_size": {"height": 64, "width": 64}, "mask_pad_size": {"height": 64, "width": 64}}
    words = t.BertTokenizer(vocab={word: i for i, word in enumerate(WORDS)})
    looks = t.GroundingDinoImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96})
    cuts = t.SamImageProcessorPil(size={"longest_edge": 64}, mask_size={"longest_edge": 64}, **sizes)
    root = tmp_path_factory.mktemp("models")
    for name, model, processor in (("detector", detector, t.GroundingDinoProcessor(looks, words)),
                                   ("segmenter", segmenter, t.SamProcessor(cuts))):  # fmt: skip
        model.save_pretrained(root / name)
        processor.save_pretrained(root / name)
    return root / "detector", root / "segmenter"


def test_what_is_named_gets_a_mask(folders: tuple[Path, Path]) -> None:
    """Untrained models find something anywhere; each prompt's mask has its number, the object in front of the goal."""
    masks = grounded(*folders, {3: "red cup", 4: "blue mat"}, least=0.0)
    found = masks(FRAME, 0)
    assert found.shape == FRAME.shape[:2] and found.dtype == np.uint8
    assert set(np.unique(found)) <= {0, 3, 4} and (found == 3).any()
    assert np.array_equal(found == 3, grounded(*folders, {3: "red cup"}, least=0.0)(FRAME, 0) == 3)


def test_what_is_not_found_has_no_mask(folders: tuple[Path, Path]) -> None:
    assert not grounded(*folders, {3: "red cup"}, least=1.0)(FRAME, 0).any()


def test_a_folder_without_a_model_is_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(VisionError, match="none does not exist"):
        grounded(tmp_path / "none", folders[1], {3: "red cup"})
    with pytest.raises(VisionError, match="holds no such model"):
        grounded(folders[0], tmp_path, {3: "red cup"})


def test_without_the_library_the_way_out_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(module.importlib, "import_module", missing)
    with pytest.raises(MissingExtraError, match="pip install"):
        grounded(tmp_path, tmp_path, {3: "red cup"})
