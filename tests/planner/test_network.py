from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.planner.config import EncoderConfig, LossConfig
from ocplanner.planner.encoder import ImageEncoder, SpatialSoftmax
from ocplanner.planner.network import Normaliser, PlannerNetwork
from ocplanner.planner.predictor import latent_distance, winner_takes_all
from ocplanner.planner.vae import Latent, kl_between, kl_to_prior, trajectory_loss
from ocplanner.training.optimisation import BatchOrder

SEEDS = st.integers(0, 1000)


def rotations(seed: int, count: int = 5) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None]
    q[np.linalg.det(q) < 0, :, 2] *= -1
    return q


def latent(*shape: int, seed: int = 0) -> Latent:
    generator = torch.Generator().manual_seed(seed)
    return Latent(torch.randn(shape, generator=generator), 0.3 * torch.randn(shape, generator=generator))


@given(SEEDS)
def test_normalising_is_invertible(seed):
    rng = np.random.default_rng(seed)
    positions, matrices = rng.normal(size=(5, 3)), rotations(seed)
    normaliser = Normaliser.fit(positions)
    found, turned = normaliser.decode(normaliser.encode(positions, matrices))
    assert np.allclose(found, positions, atol=1e-5)
    assert np.allclose(turned, matrices, atol=1e-5)
    assert normaliser.decode(normaliser.encode(positions, None))[1] is None


def test_an_axis_without_spread_is_harmless():
    assert np.isfinite(Normaliser.fit(np.ones((4, 3))).encode(np.ones((1, 3)), None)).all()


@pytest.mark.parametrize(
    ("encoder", "outputs", "size", "modes"),
    [
        (EncoderConfig(), "pose", 9, 1),
        (EncoderConfig(), "position", 3, 3),
        (EncoderConfig(type="resnet18", pool="spatial_softmax"), "pose", 9, 3),
    ],
)
def test_shapes(tiny, encoder, outputs, size, modes):
    config = replace(tiny().network, encoder=encoder, outputs=outputs, modes=modes)
    network = PlannerNetwork(config, ("a", "b")).eval()
    images = {camera: torch.rand(2, 3, 76, 76) for camera in ("a", "b")}
    with torch.inference_mode():
        prediction = network.predictor(images)
        assert prediction.latent.mu.shape == prediction.latent.log_sigma.shape == (2, modes, 4)
        assert prediction.logits.shape == (2, modes)
        assert network(images).shape == (2, 5, size)


def test_the_most_probable_mode_is_planned(tiny):
    network = PlannerNetwork(replace(tiny().network, modes=3), ("agentview",)).eval()
    with torch.inference_mode():
        images = {"agentview": torch.rand(4, 3, 76, 76)}
        prediction = network.predictor(images)
        for row, mode in enumerate(prediction.logits.argmax(dim=1)):
            assert torch.equal(prediction.best[row], prediction.latent.mu[row, mode])


def test_spatial_softmax_finds_peaks():
    pool = SpatialSoftmax(2, 5, 9, 2, temperature=0.01)
    torch.nn.init.eye_(pool.keypoints.weight[:, :, 0, 0])
    torch.nn.init.zeros_(pool.keypoints.bias)
    features = torch.zeros(1, 2, 5, 9)
    features[0, 0, 0, 8] = 1
    features[0, 1, 4, 4] = 1
    torch.testing.assert_close(pool(features), torch.tensor([[1.0, -1.0, 0.0, 1.0]]), atol=1e-4, rtol=0)


def test_building_an_encoder_leaves_its_statistics_alone():
    encoder = ImageEncoder(EncoderConfig(), 76)
    assert encoder.training
    assert float(encoder.trunk.norm[0].running_mean.abs().max()) == 0


def test_trajectory_loss_weighs_position_and_rotation():
    predicted, true = torch.zeros(2, 4, 9), torch.ones(2, 4, 9)
    assert trajectory_loss(predicted, true, LossConfig(position=1, rotation=0)).tolist() == [12, 12]
    assert trajectory_loss(predicted, true, LossConfig(position=0, rotation=2)).tolist() == [48, 48]


def test_kl_divergences():
    a, b = latent(3, 4, seed=1), latent(3, 4, seed=2)
    prior = Latent(torch.zeros(3, 4), torch.zeros(3, 4))
    assert (kl_between(a, b) > 0).all()
    torch.testing.assert_close(kl_between(a, a), torch.zeros(3))
    torch.testing.assert_close(kl_to_prior(a), kl_between(prior, a))
    normal = torch.distributions.Normal
    expected = torch.distributions.kl_divergence(normal(b.mu, b.log_sigma.exp()), normal(a.mu, a.log_sigma.exp())).sum(
        dim=-1
    )
    torch.testing.assert_close(kl_between(a, b), expected)


def test_the_latent_distance_is_l2_on_mu_and_sigma():
    a, b = latent(2, 4, seed=1), latent(2, 4, seed=2)
    expected = ((a.mu - b.mu) ** 2).sum(-1) + ((a.log_sigma.exp() - b.log_sigma.exp()) ** 2).sum(-1)
    torch.testing.assert_close(latent_distance(a, b, LossConfig()), expected)
    assert not torch.allclose(latent_distance(a, b, LossConfig(latent="kl")), expected)


def test_winner_takes_all_prefers_the_closest():
    losses = torch.tensor([[1.0, 9.0]], requires_grad=True)
    logits = torch.zeros(1, 2, requires_grad=True)
    winner_takes_all(losses, logits, LossConfig(other_modes=0.0)).backward()
    assert losses.grad.tolist() == [[1.0, 0.0]]
    assert logits.grad[0, 0] < 0 < logits.grad[0, 1]


def test_one_mode_is_the_plain_mean():
    losses = torch.tensor([[1.0], [3.0]])
    assert winner_takes_all(losses, torch.zeros(2, 1), LossConfig()) == 2


@given(count=st.integers(1, 40), batch=st.integers(1, 60), seed=SEEDS)
def test_every_epoch_reads_every_frame_once(count, batch, seed):
    order = BatchOrder(count, batch, (seed,))
    rows = np.concatenate([order.rows(step) for step in range(2 * count)])[: 2 * count]
    assert sorted(rows[:count]) == sorted(rows[count:]) == list(range(count))
    assert np.array_equal(BatchOrder(count, batch, (seed,)).rows(count), order.rows(count))
