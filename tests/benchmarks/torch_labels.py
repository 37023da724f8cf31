"""Reward labelling as one writes it with h5py, torch and NumPy: the peer of ``ocplanner label --reward augment``."""

from pathlib import Path

import h5py
import numpy as np
import torch
from numpy_reward import Rewards, plan_reward
from planner_weights import PlannerWeights
from torch_planner import TorchPlanner

from ocplanner.control.grasp_detection import held_steps
from ocplanner.geometry.rotation import rotation_from_quat_xyzw


class TorchLabeller:
    """Labels a file of Square whose ``object`` begins with the nut's pose; checks nothing, and cannot be resumed.

    Args:
        weights: of the planner.
        as_trained: see :class:`torch_planner.TorchPlanner`.
    """

    def __init__(self, weights: PlannerWeights, *, as_trained: bool) -> None:
        self._model = TorchPlanner(weights.planning(1), as_trained=as_trained)
        (self._camera,) = weights.config["cameras"]

    def label(self, source: Path, pictures: Path, target: Path, names: list[str]) -> None:
        """Write a copy of ``source`` with rewards, their terms, and ``next_obs``."""
        with h5py.File(source) as read, h5py.File(pictures) as drawn, h5py.File(target, "w") as write:
            data = write.create_group("data")
            data.attrs.update(read["data"].attrs)
            for name in names:
                read.copy(f"data/{name}", data, name=name)
                demo = data[name]
                sparse, obs = demo["rewards"][:], demo["obs"]
                terms = self._terms(demo, drawn[f"data/{name}/obs/{self._camera}_image"])
                del demo["rewards"]
                demo["rewards"], demo["rewards_sparse"] = sparse + terms.reward, sparse
                demo["ocp_reward_position"], demo["ocp_reward_rotation"] = terms.position, terms.rotation
                for key in obs:
                    if f"next_obs/{key}" not in demo:
                        values = obs[key][:]
                        demo[f"next_obs/{key}"] = np.concatenate([values[1:], values[-1:]])

    def _terms(self, demo: h5py.Group, images: h5py.Dataset) -> Rewards:
        pose, eef = demo["obs/object"][:, :7], demo["obs/robot0_eef_pos"][:]
        position, rotation = pose[:, :3].astype(np.float64), rotation_from_quat_xyzw(pose[:, 3:].astype(np.float64))
        held = held_steps(position, rotation, eef, demo["actions"][:, -1])
        following = [np.concatenate([poses[1:], poses[-1:]]) for poses in (position, rotation)]
        planned = [poses.copy() for poses in following]
        rows = np.flatnonzero(held)
        if len(rows):
            pictures = images[rows[0] : rows[-1] + 1][rows - rows[0]]
            with torch.inference_mode():
                plans = [
                    self._model([torch.from_numpy(part)]) for part in np.array_split(pictures, -(-len(rows) // 64))
                ]
            for part, wanted in enumerate(planned):
                wanted[rows] = np.concatenate([plan[part].numpy()[:, 0] for plan in plans])
        return plan_reward((planned[0], planned[1]), (following[0], following[1]), held)
