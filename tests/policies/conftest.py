"""Small policies and observations."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch

from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import HintConfig, NetworkConfig, ObservationConfig, PolicyTraining, preset
from ocplanner.policies.data import Samples
from ocplanner.policies.observation import Observation

LOW_DIM, ACTIONS = 23, 7


@pytest.fixture(autouse=True)
def _one_thread():
    """These networks are too small to share out."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    yield
    torch.set_num_threads(before)


class Killed(BaseException):
    """Stands for a kill: nothing in the library catches it."""


@pytest.fixture
def killed(monkeypatch):
    """``with killed("batch", 13):`` training stops dead at the 14th batch that this method of Samples draws."""

    @contextmanager
    def after(method: str, batches: int) -> Iterator[None]:
        original, learned = getattr(Samples, method), []

        def batch(self, rows, config, device, rng):
            learned.append(rng is not None)
            if sum(learned) > batches:
                raise Killed
            return original(self, rows, config, device, rng)

        with monkeypatch.context() as patch:
            patch.setattr(Samples, method, batch)
            with pytest.raises(Killed):
                yield

    return after


@pytest.fixture
def rewarded(tiny_square, tmp_path):
    """Half of the actions go right, for a reward of 1, the others left."""
    path = tmp_path / "rewarded.hdf5"
    shutil.copy(tiny_square(), path)
    rng = np.random.default_rng(0)
    with h5py.File(path, "a") as file:
        for demo in file["data"].values():
            right = rng.random(len(demo["actions"])) < 0.5
            demo["actions"][:] = np.where(right, 0.7, -0.7)[:, None] + rng.normal(0, 0.02, demo["actions"].shape)
            demo["rewards"][:], demo["dones"][:] = right, 1
    return path


@pytest.fixture(scope="session")
def small() -> Callable[..., PolicyTraining]:
    """``small(algorithm="bc", hint=None, cameras=(), **changes)``: a policy that trains in milliseconds."""

    def make(
        algorithm="bc", hint: tuple[int, ...] | None = None, cameras: tuple[str, ...] = (), **changes
    ) -> PolicyTraining:
        base = preset("cpu", algorithm)
        encoder = EncoderConfig(channels=(4, 8, 8), feature=8)
        observation = ObservationConfig(cameras=cameras, normalise=True, encoder=encoder)
        network = NetworkConfig(
            hidden=(32, 32), lstm_hidden=16, sequence=5, hint=None if hint is None else HintConfig(hint)
        )
        if algorithm == "bcq":
            bcq = BCQConfig((16, 16), vae_hidden=(16, 16), latent=4, proposals=3, rollout_proposals=8)
            changes = {"algorithm_settings": bcq, **changes}
        changes = {"batch": 16, "steps": 20, "save_every": 10, "validate_every": 5, "checkpoint_every": 5, **changes}
        return replace(base, observation=observation, network=network, **changes)

    return make


@pytest.fixture
def observe() -> Callable[..., Observation]:
    """``observe(shape, hint_width=None, cameras=())``: random observations."""

    def make(shape: tuple[int, ...], hint_width: int | None = None, cameras: tuple[str, ...] = ()) -> Observation:
        generator = torch.Generator().manual_seed(1)
        hint = None
        if hint_width is not None:
            hint = torch.randn(*shape, hint_width, generator=generator)
            hint[..., -1] = 1
        return Observation(
            torch.randn(*shape, LOW_DIM, generator=generator),
            {name: torch.rand(*shape, 3, 76, 76, generator=generator) for name in cameras},
            hint,
        )

    return make
