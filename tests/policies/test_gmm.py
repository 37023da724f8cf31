import pytest
import torch
from torch import distributions

from ocplanner.policies.config import GmmConfig
from ocplanner.policies.gmm import GmmHead, Mixture


def mixture(*batch: int, modes: int = 5, actions: int = 7) -> Mixture:
    generator = torch.Generator().manual_seed(0)
    shape = (*batch, modes, actions)
    means, spread = torch.randn(shape, generator=generator), torch.rand(shape, generator=generator)
    return Mixture(torch.randn(*batch, modes, generator=generator).double(), means.double(), 0.01 + spread.double())


@pytest.mark.parametrize("batch", [(6,), (4, 3)])
def test_the_likelihood_is_torchs(batch):
    ours = mixture(*batch)
    theirs = distributions.MixtureSameFamily(
        distributions.Categorical(logits=ours.logits),
        distributions.Independent(distributions.Normal(ours.means, ours.stds), 1),
    )
    actions = torch.randn(*batch, 7, generator=torch.Generator().manual_seed(2)).double()
    torch.testing.assert_close(ours.log_likelihood(actions), theirs.log_prob(actions), rtol=1e-12, atol=1e-10)


def test_a_far_action_has_a_finite_likelihood_and_gradient():
    ours = mixture(3)
    ours.means.requires_grad_()
    value = ours.log_likelihood(torch.full((3, 7), 1e3, dtype=torch.float64)).sum()
    value.backward()
    assert torch.isfinite(value)
    assert torch.isfinite(ours.means.grad).all()


@pytest.mark.parametrize("decided", [False, True])
def test_samples_have_the_mixtures_moments(decided):
    one, generator = mixture(1, modes=3, actions=2), torch.Generator().manual_seed(3)
    if decided:
        noise = torch.randn(1, 200_000, 3, generator=generator, dtype=torch.float64)
        samples = one.at(noise, low_noise=False)[0]
    else:
        many = Mixture(*(part.expand(200_000, *part.shape[1:]) for part in (one.logits, one.means, one.stds)))
        samples = many.sample(low_noise=False, generator=generator)
    weights = one.logits[0].softmax(-1)[:, None]
    mean = (weights * one.means[0]).sum(0)
    second = (weights * (one.means[0] ** 2 + one.stds[0] ** 2)).sum(0)
    torch.testing.assert_close(samples.mean(0), mean, rtol=0, atol=0.02)
    torch.testing.assert_close(samples.square().mean(0), second, rtol=0, atol=0.05)


def test_low_noise_samples_lie_at_a_mode_and_repeat_with_the_seed():
    ours = mixture(4, 50)
    first, again = (ours.sample(True, torch.Generator().manual_seed(5)) for _ in range(2))
    assert torch.equal(first, again)
    distance = (first.unsqueeze(-2) - ours.means).abs().amax(-1).amin(-1)
    assert 0 < distance.max() < 1e-3
    one = mixture(4)
    decided = one.at(torch.randn(4, 50, 8, generator=torch.Generator().manual_seed(5)).double(), low_noise=True)
    distance = (decided.unsqueeze(-2) - one.means[:, None]).abs().amax(-1).amin(-1)
    assert 0 < distance.max() < 1e-3


@pytest.mark.parametrize("activation", ["softplus", "exp"])
@pytest.mark.parametrize("tanh_means", [True, False])
def test_the_head_follows_its_configuration(activation, tanh_means):
    head = GmmHead(8, 7, GmmConfig(modes=3, min_std=0.25, std_activation=activation, tanh_means=tanh_means))
    features = 30 * torch.randn(2, 5, 8)
    raw = head.linear(features)
    result = head(features)
    assert result.logits.shape == (2, 5, 3)
    means = raw[..., :21].unflatten(-1, (3, 7))
    torch.testing.assert_close(result.means, means.tanh() if tanh_means else means)
    stds = raw[..., 21:42].unflatten(-1, (3, 7))
    expected = torch.nn.functional.softplus(stds) if activation == "softplus" else stds.exp()
    torch.testing.assert_close(result.stds, expected + 0.25)
    assert result.stds.min() >= 0.25
