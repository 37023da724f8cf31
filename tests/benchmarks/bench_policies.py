"""Training steps of BC and BC-RNN against robomimic's own, on the same configuration and data.

Run from the repository's root: ``python tests/benchmarks/bench_policies.py --data square_ph.hdf5``. Each side trains in
a process of its own, as its user would run it, and they take turns of some steps each, one thread, at the published
hyperparameters of Square PH from states; robomimic in float32, as it always trains on a CPU. A step is all that the
training loop does: fetching and collating the batch, the loss, gradients, the optimiser, and what each side records.
``without data`` leaves the fetching out on both sides.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from machine import machine_and_load
from turns import Player, Turn, taking_turns

from ocplanner.policies.config import Precision, preset
from ocplanner.policies.train import _fabric, _Training, read
from ocplanner.training.memory import keep_freed_memory
from ocplanner.training.optimisation import BatchOrder
from ocplanner.training.run_folder import RunFolder
from ocplanner.versions import installed

_OUTPUT = Path("results/bench_policies.json")
_CASES: dict[str, tuple[str, Precision]] = {
    "bc state batch 100": ("bc", "float32"),
    "bc-rnn state batch 100": ("bc-rnn", "float32"),
    "bc state batch 100, ours bfloat16": ("bc", "bfloat16"),
    "bc-rnn state batch 100, ours bfloat16": ("bc-rnn", "bfloat16"),
}


class Ours:
    """Steps of ``ocplanner train-policy --preset robomimic``."""

    def __init__(self, algorithm: str, precision: Precision, data: Path) -> None:
        torch.set_num_threads(1)
        keep_freed_memory()
        config = replace(preset("robomimic", algorithm), precision=precision)  # type: ignore[arg-type]
        recorded = read(config, data)
        self._fetch, self._fetching = recorded.train.batch, 0.0
        object.__setattr__(recorded.train, "batch", self._timed)
        self._folder = tempfile.TemporaryDirectory()
        fabric, folder = _fabric(config, 1, elastic=False), RunFolder(Path(self._folder.name))
        self._training = _Training(fabric, recorded, folder)
        self._order = BatchOrder(len(recorded.train), config.batch, (0, 0))

    def _timed(self, *arguments: Any) -> Any:
        start = time.perf_counter()
        batch = self._fetch(*arguments)
        self._fetching = time.perf_counter() - start
        return batch

    def prepare(self, index: int) -> None:
        """Nothing."""

    def act(self, index: int) -> float:
        """One training step; the seconds that fetching the batch took."""
        self._training._step(self._order.rows(index), index)
        return self._fetching


class Robomimics:
    """Steps of robomimic's ``run_epoch`` with the same sizes, its data set cached in memory as its templates say."""

    def __init__(self, algorithm: str, data: Path) -> None:
        from robomimic.algo import algo_factory
        from robomimic.config import config_factory
        from robomimic.utils import file_utils, obs_utils, train_utils
        from torch.utils.data import DataLoader

        torch.set_num_threads(1)
        rnn, low_dim = algorithm == "bc-rnn", ["object", "robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos"]
        config = config_factory("bc")
        with config.values_unlocked():
            config.train.data, config.train.hdf5_filter_key = [{"path": str(data)}], "train"
            config.train.hdf5_cache_mode, config.train.batch_size = "all", 100
            config.train.seq_length = 10 if rnn else 1
            config.train.cuda = config.experiment.validate = False
            config.algo.gmm.enabled = True
            config.algo.actor_layer_dims = () if rnn else (1024, 1024)
            config.algo.rnn.enabled, config.algo.rnn.horizon, config.algo.rnn.hidden_dim = rnn, 10, 400
            config.observation.modalities.obs.low_dim = low_dim
        config.unlock()  # robomimic's train.py adds these two itself
        config.algo.optim_params.policy.num_train_batches = config.algo.optim_params.policy.num_epochs = 100
        config.lock()
        with redirect_stdout(StringIO()):
            obs_utils.initialize_obs_utils_with_config(config)
            meta = file_utils.get_shape_metadata_from_dataset(
                dataset_config={"path": str(data)}, action_keys=["actions"], all_obs_keys=low_dim
            )
            dataset, _ = train_utils.load_data_for_training(config, obs_keys=low_dim)
            self._model = algo_factory("bc", config, meta["all_shapes"], meta["ac_dim"], torch.device("cpu"))
        self._loader = DataLoader(dataset, batch_size=100, shuffle=True, num_workers=0, drop_last=True)
        self._batches = iter(self._loader)
        self._model.set_train()

    def prepare(self, index: int) -> None:
        """Nothing."""

    def act(self, index: int) -> float:
        """One training step; the seconds that fetching the batch took."""
        start = time.perf_counter()
        batch = next(self._batches, None)
        if batch is None:
            self._batches = iter(self._loader)
            batch = next(self._batches)
        fetching = time.perf_counter() - start
        batch = self._model.process_batch_for_training(batch)
        batch = self._model.postprocess_batch_for_training(batch, obs_normalization_stats=None)
        info = self._model.train_on_batch(batch, 0, validate=False)
        self._model.on_gradient_step()
        self._model.log_info(info)
        return fetching


Seconds = tuple[np.ndarray, np.ndarray]
"""(turns,) seconds a step of each turn: whole, and without fetching the batch."""


def seconds(played: Sequence[Turn], steps: int) -> Seconds:
    """Of turns of some steps each, the mean step's."""
    whole = np.array([turn.wall for turn in played]).reshape(-1, steps).mean(axis=1)
    fetching = np.array([turn.value for turn in played]).reshape(-1, steps).mean(axis=1)
    return whole, whole - fetching


def row(case: str, taken: dict[str, Seconds]) -> dict[str, Any]:
    """Medians in ms a step, and how many times as long robomimic takes."""
    (mine, mine_bare), (theirs, theirs_bare) = taken["ours"], taken["robomimic"]
    return {
        "case": case,
        "unit": "ms a step",
        "ours": round(1e3 * float(np.median(mine)), 2),
        "peers": {"robomimic": round(1e3 * float(np.median(theirs)), 2)},
        "ratio": {"robomimic": round(float(np.median(theirs / mine)), 2)},
        "without data": {
            "ours": round(1e3 * float(np.median(mine_bare)), 2),
            "peers": {"robomimic": round(1e3 * float(np.median(theirs_bare)), 2)},
            "ratio": {"robomimic": round(float(np.median(theirs_bare / mine_bare)), 2)},
        },
        "turns": len(mine),
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("square_ph.hdf5"))
    parser.add_argument("--turns", type=int, default=20)
    parser.add_argument("--steps", type=int, default=10, help="training steps in a turn")
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    options = parser.parse_args()
    rows = []
    for case, (algorithm, precision) in _CASES.items():
        sides: dict[str, Callable[[], Player]] = {
            "ours": partial(Ours, algorithm, precision, options.data),
            "robomimic": partial(Robomimics, algorithm, options.data),
        }
        played = taking_turns(sides, options.turns, options.steps)
        rows.append(row(case, {name: seconds(turns, options.steps) for name, turns in played.items()}))
        print(json.dumps(rows[-1]))  # noqa: T201
    result = {
        "machine": machine_and_load(),
        "command": f"python tests/benchmarks/bench_policies.py --turns {options.turns} --steps {options.steps}",
        "versions": installed(),
        "rows": rows,
    }
    options.output.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
