"""BCQ against robomimic's own class: the same weights and the same random numbers give the same numbers."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from lightning_fabric import Fabric

from ocplanner.policies.bcq import BatchConstrainedQ
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.bcq_network import BCQ, Critic, target_values
from ocplanner.policies.network import make_network
from ocplanner.policies.observation import Observation
from ocplanner.policies.transitions import TransitionBatch

from robomimic.algo import algo_factory  # isort: skip
from robomimic.config import config_factory  # isort: skip
from robomimic.utils import obs_utils, torch_utils  # isort: skip

KEYS = {"object": [14], "robot0_eef_pos": [3], "robot0_eef_quat": [4], "robot0_gripper_qpos": [2]}
BATCH, LATENT, PROPOSALS = 6, 4, 3


@pytest.fixture
def theirs(small):
    """robomimic's BCQ with the sizes of ``small``, unnormalised observations, and no file behind it."""
    config = config_factory("bcq")
    with config.values_unlocked():
        config.observation.modalities.obs.low_dim = list(KEYS)
        vae, critic = config.algo.action_sampler.vae, config.algo.critic
        vae.latent_dim, vae.kl_weight = LATENT, 0.05
        vae.encoder_layer_dims = vae.decoder_layer_dims = critic.layer_dims = (16, 16)
        critic.num_action_samples, critic.num_action_samples_rollout = PROPOSALS, 8
        config.algo.target_tau = 0.25
        for part in config.algo.optim_params.values():
            part.learning_rate.initial = 1e-3
    config.unlock()
    for part in config.algo.optim_params.values():
        part.num_train_batches = part.num_epochs = 10
    config.lock()
    obs_utils.initialize_obs_utils_with_config(config)
    model = algo_factory("bcq", config, KEYS, 7, torch.device("cpu"))
    model.set_train()
    return model


@pytest.fixture
def bcq(small):
    config = small("bcq", learning_rate=1e-3, ema=0.0, clip=None, schedule="constant", warmup=0)
    settings = replace(config.algorithm_settings, tau=0.25, critic_learning_rate=1e-3)
    config = replace(config, observation=replace(config.observation, normalise=False), algorithm_settings=settings)
    return config, make_network(config, 23, 7)


class Given:
    """Samples that are one batch."""

    def __init__(self, batch: TransitionBatch) -> None:
        self._batch = batch

    def transition_batch(self, *_) -> TransitionBatch:
        return self._batch


def linears(module) -> list[torch.nn.Linear]:
    return [part for part in module.modules() if isinstance(part, torch.nn.Linear)]


def take_over(ours: BCQ, theirs) -> None:
    """robomimic's weights; ours has mean and log-variance in one layer."""
    vae = theirs.nets["action_sampler"]._vae.nets
    *hidden, mean, log_variance = linears(vae["encoder"])
    pairs = list(zip(linears(ours.sampler.encoder), hidden, strict=True))
    pairs += zip([*linears(ours.sampler.decoder), ours.sampler.action], linears(vae["decoder"]), strict=True)
    for critic, other in zip(ours.critics.members, theirs.nets["critic"], strict=True):
        pairs += zip(linears(critic), linears(other), strict=True)
    with torch.no_grad():
        for name in ("weight", "bias"):
            getattr(ours.sampler.posterior, name).copy_(torch.cat([getattr(mean, name), getattr(log_variance, name)]))
            for own, other in pairs:
                getattr(own, name).copy_(getattr(other, name))


def transitions() -> dict:
    draw = torch.Generator().manual_seed(3)
    rows = [{key: torch.randn(BATCH, *shape, generator=draw) for key, shape in KEYS.items()} for _ in range(2)]
    rewards = torch.randn(BATCH, 1, generator=draw)
    dones = torch.tensor([[0.0], [1], [0], [0], [1], [0]])
    actions = torch.rand(BATCH, 7, generator=draw) * 2 - 1
    return {
        "obs": rows[0],
        "next_obs": rows[1],
        "goal_obs": None,
        "actions": actions,
        "rewards": rewards,
        "dones": dones,
    }


def seen(rows: dict) -> Observation:
    return Observation(torch.cat(list(rows.values()), dim=-1), {}, None)


def test_losses_targets_and_choices_are_robomimics(theirs, bcq, monkeypatch):
    _, ours = bcq
    take_over(ours, theirs)
    batch, noise = transitions(), torch.randn(BATCH, 1 + PROPOSALS, LATENT)
    monkeypatch.setattr(
        torch_utils, "reparameterize", lambda mu, logvar: mu + (0.5 * logvar).clamp(-4, 15).exp() * noise[:, 0]
    )
    info, _ = theirs._train_action_sampler_on_batch(batch, 0, no_backprop=True)
    imitated = ours.sampler(seen(batch["obs"]), batch["actions"], noise[:, 0])
    torch.testing.assert_close(imitated["vae_reconstruction"], info["action_sampler/recons_loss"])
    torch.testing.assert_close(imitated["kl"], info["action_sampler/kl_loss"])

    prior = theirs.nets["action_sampler"]._vae.nets["prior"]
    monkeypatch.setattr(prior, "sample", lambda n, **_: noise[:, 1:].reshape(n, LATENT))
    info, _ = theirs._train_critic_on_batch(batch, None, 0, no_backprop=True)
    following = seen(batch["next_obs"])
    values = ours.critics.values(following, ours.sampler.propose(following, noise[:, 1:]))
    targets = target_values(batch["rewards"][:, 0], batch["dones"][:, 0], values, ours.config)
    torch.testing.assert_close(targets, info["critic/q_targets"][:, 0])
    losses, _ = ours.critics(seen(batch["obs"]), batch["actions"], targets)
    torch.testing.assert_close(losses[0], info["critic/critic1_loss"])
    torch.testing.assert_close(losses[1], info["critic/critic2_loss"])

    theirs.set_eval()
    draws = torch.randn(BATCH, 8, LATENT, generator=torch.Generator().manual_seed(5))
    monkeypatch.setattr(prior, "sample", lambda n, **_: draws.reshape(n, LATENT))
    expected = theirs.get_action(batch["obs"])
    action, memory = ours.act(seen(batch["obs"]), None, torch.Generator().manual_seed(5))
    torch.testing.assert_close(action, expected)
    assert memory is None


def test_training_steps_are_robomimics(theirs, bcq, monkeypatch):
    """Weights after three steps of the whole algorithm: both updates, their order, and the targets that follow."""
    config, ours = bcq
    take_over(ours, theirs)
    learner = BatchConstrainedQ(Fabric(accelerator="cpu", devices=1), config, ours)
    batch = transitions()
    draws = {}
    monkeypatch.setattr(
        torch_utils, "reparameterize", lambda mu, logvar: mu + (0.5 * logvar).clamp(-4, 15).exp() * draws["now"][:, 0]
    )
    prior = theirs.nets["action_sampler"]._vae.nets["prior"]
    monkeypatch.setattr(prior, "sample", lambda n, **_: draws["now"][:, 1:].reshape(n, LATENT))

    shown = TransitionBatch(
        seen(batch["obs"]), batch["actions"], batch["rewards"][:, 0], batch["dones"][:, 0], seen(batch["next_obs"])
    )
    for step in range(3):
        draws["now"] = learner._noise(BATCH, (2, step))
        info = theirs.log_info(theirs.train_on_batch(batch, 0))
        reported = learner.step(Given(shown), np.arange(BATCH), step)
        assert float(reported["loss"]) == pytest.approx(info["Loss"], rel=1e-4)
        assert float(reported["vae_reconstruction"]) == pytest.approx(
            info["Action_Sampler/Reconsruction_Loss"], rel=1e-4
        )
        assert float(reported["kl"]) == pytest.approx(info["Action_Sampler/KL_Loss"], rel=1e-4)
    for own, other in zip(learner._targets.members, theirs.nets["critic_target"], strict=True):
        for a, b in zip(linears(own), linears(other), strict=True):
            torch.testing.assert_close(a.weight, b.weight, rtol=1e-4, atol=1e-6)
    for own, other in zip(ours.critics.members, theirs.nets["critic"], strict=True):
        for a, b in zip(linears(own), linears(other), strict=True):
            torch.testing.assert_close(a.weight, b.weight, rtol=1e-4, atol=1e-6)
    decoder = linears(theirs.nets["action_sampler"]._vae.nets["decoder"])
    for a, b in zip([*linears(ours.sampler.decoder), ours.sampler.action], decoder, strict=True):
        torch.testing.assert_close(a.weight, b.weight, rtol=1e-4, atol=1e-6)


def test_the_targets_follow_batch_normalisation_too(small, observe):
    config = small("bcq", cameras=("agentview",), schedule="constant", warmup=0)
    encoder = replace(config.observation.encoder, batch_norm=True)
    config = replace(config, observation=replace(config.observation, encoder=encoder))
    network = make_network(config, 23, 7)
    learner = BatchConstrainedQ(Fabric(accelerator="cpu", devices=1), config, network)
    seen_now, after = observe((4,), cameras=("agentview",)), observe((4,), cameras=("agentview",))
    batch = TransitionBatch(seen_now, torch.rand(4, 7), torch.ones(4), torch.zeros(4), after)
    name = "members.0.seen.cameras.agentview.trunk.norm.0.running_mean"
    before = learner._targets.state_dict()[name].clone()
    learner.step(Given(batch), np.arange(4), 0)
    source, target = network.critics.state_dict()[name], learner._targets.state_dict()[name]
    assert not torch.equal(source, before)
    torch.testing.assert_close(target, before + config.algorithm_settings.tau * (source - before))


def test_nothing_is_expected_after_the_end():
    values = torch.tensor([[[1.0, 4.0]], [[3.0, 2.0]]])  # two critics, one state, two proposals
    config = BCQConfig(pessimism=0.75, discount=0.5)
    reward = torch.tensor([10.0])
    # 0.75 * (1, 2) + 0.25 * (3, 4) = (1.5, 2.5)
    torch.testing.assert_close(target_values(reward, torch.tensor([0.0]), values, config), torch.tensor([11.25]))
    torch.testing.assert_close(target_values(reward, torch.tensor([1.0]), values, config), reward)


def test_many_actions_of_an_observation_are_valued_as_one_by_one(small, observe):
    config = small("bcq", cameras=("agentview",))
    critic = Critic(config, config.algorithm_settings, 23, 7).eval()
    observation, actions = observe((2,), cameras=("agentview",)), torch.randn(2, 3, 7)
    together = critic(observation, actions)
    assert together.shape == (2, 3)
    for i in range(3):
        torch.testing.assert_close(together[:, i], critic(observation, actions[:, i]))
