from collections import OrderedDict
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robosuite.utils.observables import Observable, sensor

from ocplanner.envs.sampling import advance_observables

_SUBSTEP = 0.002


class _World:
    """Observables of a clock that counts substeps, and of each other."""

    def __init__(self, rates: list[float], disabled: int | None = None, delay: float = 0.0) -> None:
        self.substep = 0
        self.model_timestep = _SUBSTEP
        self._obs_cache: dict[str, object] = {}
        self.measured: list[tuple[str, int]] = []
        self._observables = OrderedDict((f"{i}", self._observable(f"{i}", rate)) for i, rate in enumerate(rates))
        if disabled is not None:
            self._observables[f"{disabled}"].set_enabled(False)
        if delay:
            self._observables["0"].set_delayer(lambda: delay)
        self.measured.clear()

    def _observable(self, name: str, rate: float) -> Observable:
        @sensor(modality="clock")
        def clock(obs_cache: dict[str, object]) -> np.ndarray:
            self.measured.append((name, self.substep))
            return np.array([self.substep, len(obs_cache)], dtype=float)

        return Observable(name, clock, sampling_rate=rate)

    def advance(self, substeps: int) -> None:
        self.substep += substeps

    def _update_observables(self, force: bool = False) -> None:
        for observable in self._observables.values():
            observable.update(timestep=_SUBSTEP, obs_cache=self._obs_cache, force=force)

    def state(self) -> list[object]:
        return [
            (o._time_since_last_sample, o._sampled, o._current_delay, np.array(o.obs).tolist())
            for o in self._observables.values()
        ]


@settings(max_examples=60, deadline=None)
@given(
    rates=st.lists(st.sampled_from([5, 10, 17, 20, 25, 40, 100, 333, 500]), min_size=1, max_size=4),
    control_steps=st.lists(st.sampled_from([1, 5, 25, 50]), min_size=1, max_size=12),
    disabled=st.booleans(),
    forced=st.booleans(),
)
def test_same_measurements_in_the_same_substeps(rates, control_steps, disabled, forced):
    stock, ours = (_World(rates, disabled=0 if disabled else None) for _ in range(2))
    for world in (stock, ours):
        if forced:
            world._update_observables(force=True)
    for substeps in control_steps:
        for _ in range(substeps):
            stock.advance(1)
            stock._update_observables()
        advance_observables(ours, ours.advance, substeps)
        assert ours.measured == stock.measured
        assert ours.state() == stock.state()
        assert ours.substep == stock.substep


@pytest.mark.parametrize("delay", [0.01, 0.2])
def test_delays(delay, capsys):
    stock, ours = (_World([20, 20], delay=delay) for _ in range(2))
    for _ in range(4):
        for _ in range(25):
            stock.advance(1)
            stock._update_observables()
        complaints = capsys.readouterr().out
        advance_observables(
            SimpleNamespace(**vars(ours), _update_observables=ours._update_observables), ours.advance, 25
        )
        assert capsys.readouterr().out == complaints
        assert ours.measured == stock.measured
        assert ours.state() == stock.state()
