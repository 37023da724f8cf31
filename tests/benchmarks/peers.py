"""The runtimes that the engine is measured against, one small class each.

Each peer does the engine's whole job, from uint8 images to plans in metres and rotation matrices, on the same folded
weights in float32, and is set up as its own documentation advises for latency. A peer that cannot run here raises
:class:`AbsentError` when it is created.
"""

import importlib.metadata
from typing import Protocol

import numpy as np
from planner_weights import PlannerWeights

Images = dict[str, np.ndarray]
Poses = tuple[np.ndarray, np.ndarray]


class AbsentError(Exception):
    """The peer is not installed or lacks something it needs; the message says what."""


class Peer(Protocol):
    """A planner in another runtime, set up for one batch size and a number of threads."""

    def __init__(self, weights: PlannerWeights, batch: int, threads: int) -> None: ...

    def plan(self, images: Images) -> Poses:
        """Positions (B, H, 3) m and rotations (B, H, 3, 3) of camera name -> (B, h, w, 3) uint8 images."""
        ...


class TorchEager:
    """PyTorch in inference mode, normalisation folded, channels last."""

    as_trained = False

    def __init__(self, weights: PlannerWeights, batch: int, threads: int) -> None:
        try:
            import torch
            from torch_planner import TorchPlanner
        except ImportError as error:
            raise AbsentError(str(error)) from error
        torch.set_num_threads(threads)
        self._torch = torch
        self._cameras = weights.config["cameras"]
        self._model = TorchPlanner(weights, as_trained=self.as_trained)

    def plan(self, images: Images) -> Poses:
        torch = self._torch
        with torch.inference_mode():
            position, rotation = self._model([torch.from_numpy(images[camera]) for camera in self._cameras])
            return position.numpy(), rotation.numpy()


class TorchAsTrained(TorchEager):
    """PyTorch in inference mode on the network as training leaves it, without any export."""

    as_trained = True


class TorchCompile(TorchEager):
    """The same module through torch.compile: fixed shapes, the LSTM in the graph, weights frozen and prepacked."""

    def __init__(self, weights: PlannerWeights, batch: int, threads: int) -> None:
        super().__init__(weights, batch, threads)
        try:
            import torch._dynamo.config as dynamo
            import torch._inductor.config as inductor

            dynamo.allow_rnn = True
            inductor.freezing = True
            self._model = self._torch.compile(self._model, dynamic=False)
            size = weights.config["image_size"]
            self.plan({camera: np.zeros((batch, size, size, 3), np.uint8) for camera in self._cameras})
        except Exception as error:
            # Inductor reports a missing compiler in many ways; the first line says which.
            raise AbsentError(f"torch.compile: {str(error).splitlines()[0][:200]}") from error


class OnnxRuntime:
    """onnxruntime's CPU provider, all graph optimisations, worker threads that spin only while a call runs."""

    def __init__(self, weights: PlannerWeights, batch: int, threads: int) -> None:
        try:
            import onnxruntime
            from onnx_planner import onnx_planner
        except ImportError as error:
            raise AbsentError(str(error)) from error
        options = onnxruntime.SessionOptions()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        options.add_session_config_entry("session.force_spinning_stop", "1")
        model = onnx_planner(weights, batch)
        self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def plan(self, images: Images) -> Poses:
        position, rotation = self._session.run(["position", "rotation"], images)
        return position, rotation


class OpenVino:
    """OpenVINO's CPU plugin: latency hint, one stream, float32 arithmetic, arrays shared and not copied."""

    def __init__(self, weights: PlannerWeights, batch: int, threads: int) -> None:
        try:
            import openvino
            from onnx_planner import onnx_planner
        except ImportError as error:
            raise AbsentError(str(error)) from error
        core = openvino.Core()
        settings = {
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_NUM_THREADS": threads,
            "NUM_STREAMS": 1,
            "INFERENCE_PRECISION_HINT": "f32",
            "ENABLE_CPU_PINNING": False,
        }
        model = core.read_model(onnx_planner(weights, batch))
        self._request = core.compile_model(model, "CPU", settings).create_infer_request()

    def plan(self, images: Images) -> Poses:
        results = self._request.infer(images, share_inputs=True, share_outputs=True)
        return results["position"], results["rotation"]


PEERS: dict[str, type[Peer]] = {
    "torch as trained": TorchAsTrained,
    "torch eager": TorchEager,
    "torch.compile": TorchCompile,
    "onnxruntime": OnnxRuntime,
    "openvino": OpenVino,
}


def versions() -> dict[str, str]:
    """Version of every package that is installed, by distribution name."""
    found = {}
    for name in ("ocplanner", "numpy", "torch", "onnxruntime", "openvino"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
