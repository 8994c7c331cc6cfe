"""What the svd aligner gives its networks and reads from them, with networks of a few convolutions."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import velocity
from embodiedreamer_gym.vis_aligner.latent_cache import LatentCache
from embodiedreamer_gym.vis_aligner.network_inputs import to_tensor
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdAligner, SvdSettings
from embodiedreamer_gym.vis_aligner.velocity import LARGEST, draw_sigmas, noisy_and_velocity
from tests.vis_aligner.scenes import HEIGHT, WIDTH, episode
from tests.vis_aligner.toy_svd import CHANNELS, BlockMeans, FewConvolutions, toy_svd

FRAMES, STARTS = 3, (1, 5, 9)


def chunks(count: int = 3):
    """References, conditions and true frames (K, 1 + T, H, W, 3) of some chunks."""
    where = [(episode(seed), at) for seed in range(count) for at in STARTS]
    true = np.stack([e.frames[at : at + 1 + FRAMES] for e, at in where])
    return [e.references(at) for e, at in where], [e.condition.part(at + 1, at + 1 + FRAMES) for e, at in where], true


def coarse_psnr(made: np.ndarray, true: np.ndarray) -> float:
    """PSNR in dB of the means of 8 x 8 pixels, which is all that the toy autoencoder keeps."""
    means = [x.astype(float).reshape(*x.shape[:2], HEIGHT // 8, 8, WIDTH // 8, 8, 3).mean((3, 5)) for x in (made, true)]
    return 10 * math.log10(255**2 / np.mean((means[0] - means[1]) ** 2))


def test_a_network_that_was_trained_to_predict_v_is_read_as_v(monkeypatch) -> None:
    """Its samples are the true frames; read as the clean latents, as before, its output is nearly their negative."""
    aligner, (references, conditions, true) = toy_svd(), chunks()
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        given = aligner._given(references, conditions)
        clip = aligner._latents(true) * aligner.vae.config.scaling_factor
    adamw = torch.optim.AdamW(aligner.network.parameters(), 1e-2)
    for _ in range(200):
        sigma, noise = draw_sigmas(len(clip), generator), torch.randn(clip.shape, generator=generator)
        noisy, wanted = noisy_and_velocity(clip, sigma, noise)
        adamw.zero_grad()
        torch.mean((aligner._velocity(noisy, sigma, given) - wanted) ** 2).backward()
        adamw.step()
    as_v = np.stack(aligner.render(references, conditions))
    with torch.no_grad():
        largest, noise = torch.full((len(clip),), LARGEST), torch.randn(clip.shape, generator=generator)
        read = aligner._velocity(noise, largest, given)
    monkeypatch.setattr(velocity, "clean_clip", lambda noisy, output, sigma: output)
    as_clip = np.stack(aligner.render(references, conditions))
    assert coarse_psnr(as_v, true[:, 1:]) > 26 and coarse_psnr(as_clip, true[:, 1:]) < 13
    assert np.corrcoef(read.flatten(), clip.flatten())[0, 1] < -0.95


def test_what_the_network_is_given() -> None:
    """Level 1/4 ln(sigma); latents of the condition unscaled; the frames put together from other pictures beside them."""
    aligner, (references, conditions, _) = toy_svd(steps=2), chunks(1)
    network = aligner.network
    assert network.config.in_channels == network.conv_in.in_channels == 6 * CHANNELS + 1
    assert (
        float(network.conv_in.weight[:, 2 * CHANNELS :].detach().abs().max()) == 0.0
    )  # the new ones change nothing yet
    aligner.render(references, conditions)
    assert [float(call[1][0]) for call in network.calls] == pytest.approx(
        [0.25 * math.log(s) for s in velocity.sigmas(2)[:2]]
    )
    joined = network.calls[0][0]
    last = torch.stack([to_tensor(r.last) for r in references])
    means = torch.nn.functional.avg_pool2d(last, 8)
    for number in range(1, 6):  # condition, still, plate, anchor, gallery: at the first instant all are the last frame
        assert torch.allclose(joined[:, 0, number * CHANNELS : (number + 1) * CHANNELS], means, atol=1e-6)
    simulated = joined[:, 1:, CHANNELS : 2 * CHANNELS]
    still = joined[:, 1:, 2 * CHANNELS : 3 * CHANNELS]
    assert float((simulated - still).abs().mean()) > 0.05
    assert float((still - means[:, None]).abs().mean()) < 0.2  # mostly the last frame
    assert float(joined[:, :, -1].min()) >= 0 and 0 < float(joined[:, 1:, -1].max()) <= 1  # no picture shows it
    assert network.calls[0][3].tolist()[0] == [6.0, 127.0, 0.0]


def test_decoding_in_pieces_and_bfloat16() -> None:
    references, conditions, _ = chunks(1)
    whole = toy_svd(settings=SvdSettings(decode_chunk_size=8))
    pieces = toy_svd(settings=SvdSettings(decode_chunk_size=3))
    made = [np.stack(one.render(references, conditions)) for one in (whole, pieces)]
    assert np.array_equal(*made)
    assert whole.vae.pieces == [4 * 1] * 1 and pieces.vae.pieces == [3, 1]
    half = np.stack(toy_svd(settings=SvdSettings(bf16=True)).render(references, conditions))
    apart = np.abs(half.astype(int) - made[0])
    assert apart.max() > 0 and apart.mean() < 3


def test_each_picture_is_encoded_once() -> None:
    aligner, (references, conditions, true) = toy_svd(), chunks(1)
    aligner.attempt(references, conditions, list(true[:, 1:]), torch.Generator().manual_seed(0))
    count = aligner.vae.encoded
    different = {one.tobytes() for clip in true for one in clip}
    assert len(different) < count == len(aligner.latents)
    aligner.attempt(references, conditions, list(true[:, 1:]), torch.Generator().manual_seed(1))
    assert aligner.vae.encoded == count


def test_latents_used_longest_ago_are_dropped() -> None:
    asked: list[int] = []
    cache = LatentCache(lambda x: (asked.append(len(x)), x[:, :1, :1, :1])[1], at_once=2, most=3 * 4)
    pictures = np.arange(5, dtype=np.uint8)[:, None, None, None] * np.ones((1, 8, 8, 3), np.uint8)
    assert torch.allclose(cache(pictures).flatten(), torch.arange(5) / 127.5 - 1)
    assert asked == [2, 2, 1] and len(cache) == 3
    cache(pictures[[2]])
    cache(pictures[[0]])  # drops 3
    assert asked == [2, 2, 1, 1]
    cache(pictures[[2, 4, 0]])
    assert asked == [2, 2, 1, 1]


def test_networks_of_other_channels_and_settings_are_refused() -> None:
    odd = FewConvolutions()
    odd.config = SimpleNamespace(in_channels=7, cross_attention_dim=4)
    with pytest.raises(VisionError, match="has 7 input channels"):
        SvdAligner(odd, BlockMeans())
    with pytest.raises(VisionError, match="decode_chunk_size is 0"):
        SvdSettings(decode_chunk_size=0)
