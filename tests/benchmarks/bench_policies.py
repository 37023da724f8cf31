"""Training steps of BC and BC-RNN against robomimic's own, on the same configuration and data.

Run from the repository's root: ``python tests/benchmarks/bench_policies.py --data square_ph.hdf5``. Both sides train in
one process and take turns of some steps each, one thread, at the published hyperparameters of Square PH from states. A
step is all that the training loop does: fetching and collating the batch, the loss, gradients, the optimiser, and what
each side records. ``without data`` leaves the fetching out on both sides.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from machine import machine_and_load

from ocplanner.planner.optimisation import BatchOrder
from ocplanner.planner.run_folder import RunFolder
from ocplanner.policies.config import preset
from ocplanner.policies.train import _Training, read
from ocplanner.versions import installed

_OUTPUT = Path("results/bench_policies.json")
_CASES = {"bc state batch 100": "bc", "bc-rnn state batch 100": "bc-rnn"}

Stepper = Callable[[], float]
"""Does one training step and returns the seconds that fetching the batch took."""


@contextmanager
def ours(algorithm: str, data: Path) -> Any:
    """A step of ``ocplanner train-policy --preset robomimic``."""
    config = preset("robomimic", algorithm)  # type: ignore[arg-type]
    recorded = read(config, data)
    fetch = type(recorded.train).batch
    seconds = [0.0]

    def timed(*arguments: Any) -> Any:
        start = time.perf_counter()
        batch = fetch(recorded.train, *arguments)
        seconds[0] = time.perf_counter() - start
        return batch

    object.__setattr__(recorded.train, "batch", timed)
    with tempfile.TemporaryDirectory() as folder:
        training = _Training(Fabric(accelerator="cpu", devices=1), config, recorded, RunFolder(Path(folder)))
        order, done = BatchOrder(len(recorded.train), config.batch, (0, 0)), [0]

        def step() -> float:
            training._step(order.rows(done[0]), done[0])
            done[0] += 1
            return seconds[0]

        yield step


@contextmanager
def robomimics(algorithm: str, data: Path) -> Any:
    """A step of robomimic's ``run_epoch`` with the same sizes, its data set cached in memory as its templates say."""
    from robomimic.algo import algo_factory
    from robomimic.config import config_factory
    from robomimic.utils import file_utils, obs_utils, train_utils
    from torch.utils.data import DataLoader

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
        model = algo_factory("bc", config, meta["all_shapes"], meta["ac_dim"], torch.device("cpu"))
    loader = DataLoader(dataset, batch_size=100, shuffle=True, num_workers=0, drop_last=True)
    batches = iter(loader)
    model.set_train()

    def step() -> float:
        nonlocal batches
        start = time.perf_counter()
        batch = next(batches, None)
        if batch is None:
            batches = iter(loader)
            batch = next(batches)
        fetched = time.perf_counter() - start
        batch = model.process_batch_for_training(batch)
        batch = model.postprocess_batch_for_training(batch, obs_normalization_stats=None)
        info = model.train_on_batch(batch, 0, validate=False)
        model.on_gradient_step()
        model.log_info(info)
        return fetched

    yield step


def measure(sides: dict[str, Stepper], turns: int, steps: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Seconds a step of each side, whole and without fetching, over turns in random order; a first turn is dropped."""
    rng = np.random.default_rng(0)
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in sides}
    for turn in range(turns + 1):
        for name in rng.permutation(list(sides)):
            start, fetching = time.perf_counter(), 0.0
            for _ in range(steps):
                fetching += sides[name]()
            whole = (time.perf_counter() - start) / steps
            if turn:
                taken[name].append((whole, whole - fetching / steps))
    return {name: tuple(np.array(values).T) for name, values in taken.items()}


def row(case: str, taken: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """Medians in ms a step, and how many times as long robomimic takes."""
    (mine, mine_bare), (theirs, theirs_bare) = taken["ours"], taken["robomimic"]
    return {
        "case": case,
        "unit": "ms a step",
        "ours": round(1e3 * float(np.median(mine)), 2),
        "robomimic": round(1e3 * float(np.median(theirs)), 2),
        "ratio": round(float(np.median(theirs / mine)), 2),
        "without data": {
            "ours": round(1e3 * float(np.median(mine_bare)), 2),
            "robomimic": round(1e3 * float(np.median(theirs_bare)), 2),
            "ratio": round(float(np.median(theirs_bare / mine_bare)), 2),
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
    torch.set_num_threads(1)
    rows = []
    for case, algorithm in _CASES.items():
        with ours(algorithm, options.data) as mine, robomimics(algorithm, options.data) as theirs:
            rows.append(row(case, measure({"ours": mine, "robomimic": theirs}, options.turns, options.steps)))
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
