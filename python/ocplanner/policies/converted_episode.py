"""An episode of any data set as a policy's own data set would have recorded it."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ocplanner.demos.action_frame import ActionFrame
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.object_sensors import Sensors, object_order, rearranged, sensors_of
from ocplanner.errors import MismatchError
from ocplanner.policies.data import Samples, load_samples
from ocplanner.policies.evaluable import object_of
from ocplanner.policies.policy import Policy


def load_episode(policy: Policy, demos: Demonstrations, name: str) -> Samples:
    """One demonstration with ``object`` in the policy's order and actions in its frame and scale.

    robosuite 1.4 and 1.5 differ in both. The relative poses that 1.5 records are a control step old.

    Raises:
        DatasetError: an observation is missing or of another size.
        MismatchError: another task than the policy's, or actions that cannot be turned into its frame.
    """
    header, demo = policy.header, demos[name]
    if demos.task_name != header.task:
        raise MismatchError(f"{demos.path} shows {demos.task_name}, but {policy.path} was trained on {header.task}")
    samples = load_samples(demos, [name], policy.training, header.action_range)
    low_dim, actions = samples.low_dim, samples.actions
    keys = policy.training.observation.low_dim
    wanted = object_of(header) if "object" in keys else None
    if wanted is not None:
        found = sensors_of(demos.env_name, object_order(demos, name))
        low_dim = low_dim if found == wanted else _rearranged(low_dim, demo, keys, found, wanted)
    return replace(samples, low_dim=low_dim, actions=_in_frame(actions, policy, demos, demo))


def _rearranged(low_dim: Tensor, demo: Demonstration, keys: tuple[str, ...], found: Sensors, wanted: Sensors) -> Tensor:
    """``object`` as another robosuite records it."""
    widths = [demo.observation(key, slice(0, 1)).shape[1] for key in keys]
    place = keys.index("object")
    parts = list(low_dim.split(widths, dim=1))
    parts[place] = torch.from_numpy(rearranged(parts[place].numpy(), found, wanted)).float()
    return torch.cat(parts, dim=1)


def _in_frame(actions: Tensor, policy: Policy, demos: Demonstrations, demo: Demonstration) -> Tensor:
    wanted, scale = policy.header.action_frame, policy.header.action_scale
    if wanted is None or scale is None:
        return actions
    with ActionFrame(demos) as frame:
        factors = frame.scale.position / scale.position, frame.scale.rotation / scale.rotation
        if frame.name == wanted and factors == (1.0, 1.0):
            return actions
        if frame.name != wanted and wanted != "world":
            raise MismatchError(
                f"{demos.path} has actions in the {frame.name} frame, but {policy.path} learned from the {wanted} "
                "frame; record the episode with the robosuite version of the policy's data set"
            )
        turn = np.tile(np.eye(3), (demo.length, 1, 1))
        if frame.name != wanted:
            turn = frame.rotations_world(demo, np.arange(demo.length))
    parts = [
        torch.from_numpy(np.einsum("bij,bj->bi", turn, actions[:, 3 * part : 3 * part + 3].numpy()) * factors[part])
        for part in (0, 1)
    ]
    return torch.cat([part.float() for part in parts] + [actions[:, 6:]], dim=1)
