"""The planner as an ONNX graph: uint8 images in, plans in metres and rotation matrices out.

Written node by node rather than exported, so that it holds nothing but the planner: no shape arithmetic, no casts, the
LSTM as one node, every shape fixed.
"""

from collections.abc import Sequence

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from planner_weights import PlannerWeights

_OPSET = 18
_TORCH_TO_ONNX_GATES = (0, 3, 1, 2)
"""torch orders an LSTM's gates i, f, g, o; ONNX i, o, f, g."""


def onnx_planner(weights: PlannerWeights, batch: int) -> bytes:
    """A serialised model with one (batch, h, w, 3) uint8 input a camera, named as the camera.

    Its outputs are ``position`` (batch, H, 3) and ``rotation`` (batch, H, 3, 3), float32.
    """
    graph = _Graph(weights, batch)
    features = [graph.encoder(camera) for camera in weights.config["cameras"]]
    x = features[0] if len(features) == 1 else graph.node("Concat", features, axis=1)
    for index in range(weights.predictor_layers):
        x = graph.linear(f"predictor.{index}", x)
        if index + 1 < weights.predictor_layers:
            x = graph.node("Relu", [x])
    graph.poses(graph.decoder(x))
    return graph.serialised()


class _Graph:
    def __init__(self, weights: PlannerWeights, batch: int) -> None:
        self.weights, self.batch = weights, batch
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def node(self, kind: str, inputs: Sequence[str], output: str = "", **attributes: object) -> str:
        output = output or f"{kind}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def constant(self, array: np.ndarray | Sequence[int]) -> str:
        array = np.ascontiguousarray(array) if isinstance(array, np.ndarray) else np.array(array, np.int64)
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def linear(self, name: str, x: str) -> str:
        weight, bias = self.weights.layer(name)
        return self.node("Gemm", [x, self.constant(weight), self.constant(bias)], transB=1)

    def conv(self, name: str, x: str, stride: int, padding: int) -> str:
        weight, bias = self.weights.layer(name)
        size = {"kernel_shape": weight.shape[2:], "strides": [stride] * 2, "pads": [padding] * 4}
        return self.node("Conv", [x, self.constant(weight), self.constant(bias)], **size)

    def slice(self, x: str, start: Sequence[int], end: Sequence[int], axes: Sequence[int]) -> str:
        return self.node("Slice", [x, self.constant(start), self.constant(end), self.constant(axes)])

    def encoder(self, camera: str) -> str:
        config, prefix = self.weights.config["encoder"], f"encoder.{camera}"
        inset, side = self.weights.crop
        x = self.slice(camera, [inset] * 2, [inset + side] * 2, [1, 2])
        x = self.node("Cast", [self.node("Transpose", [x], perm=[0, 3, 1, 2])], to=TensorProto.FLOAT)
        if config["type"] == "small":
            for index in range(len(config["channels"])):
                x = self.node("Relu", [self.conv(f"{prefix}.conv.{index}", x, 2, 1)])
                side = (side - 1) // 2 + 1
        else:
            x, side = self._resnet18(prefix, x, side)
        if config["pool"] == "spatial_softmax":
            keypoints = config["keypoints"]
            logits = self.conv(f"{prefix}.keypoints", x, 1, 0)
            flat = self.node("Reshape", [logits, self.constant([self.batch, keypoints, side * side])])
            along = np.linspace(-1, 1, side, dtype=np.float32)
            pixels = np.stack([np.tile(along, side), np.repeat(along, side)], 1)
            mean = self.node("MatMul", [self.node("Softmax", [flat], axis=-1), self.constant(pixels)])
            x = self.node("Reshape", [mean, self.constant([self.batch, 2 * keypoints])])
        else:
            x = self.node("Flatten", [x], axis=1)
        x = self.linear(f"{prefix}.fc", x)
        return self.node("Relu", [x]) if config.get("feature_relu") else x

    def _resnet18(self, prefix: str, x: str, side: int) -> tuple[str, int]:
        x = self.node("Relu", [self.conv(f"{prefix}.stem", x, 2, 3)])
        x = self.node("MaxPool", [x], kernel_shape=[3, 3], strides=[2, 2], pads=[1] * 4)
        side = ((side - 1) // 2) // 2 + 1
        for layer in range(1, 5):
            for block in range(2):
                name = f"{prefix}.layer{layer}.{block}"
                shrinks = layer > 1 and block == 0
                shortcut = self.conv(f"{name}.downsample", x, 2, 0) if shrinks else x
                middle = self.node("Relu", [self.conv(f"{name}.conv1", x, 2 if shrinks else 1, 1)])
                x = self.node("Relu", [self.node("Add", [self.conv(f"{name}.conv2", middle, 1, 1), shortcut])])
                side = (side - 1) // 2 + 1 if shrinks else side
        return x, side

    def decoder(self, latent: str) -> str:
        """Steps (H, batch, hidden) of the LSTM."""
        tensors, hidden = self.weights.tensors, self.weights.config["decoder"]["hidden"]
        state = self.node("Tanh", [self.linear("decoder.init", latent)])
        first = [
            self.node("Unsqueeze", [self.slice(state, [start], [start + hidden], [1]), self.constant([0])])
            for start in (0, hidden)
        ]

        def gates(array: np.ndarray) -> np.ndarray:
            return np.concatenate([array[hidden * gate : hidden * (gate + 1)] for gate in _TORCH_TO_ONNX_GATES])[None]

        weight = [self.constant(gates(tensors[f"decoder.lstm.{name}"])) for name in ("weight_ih", "weight_hh")]
        bias = gates(tensors["decoder.lstm.bias"])
        every_step = self.constant([self.weights.config["horizon"], self.batch, self.weights.config["latent"]])
        inputs = self.node("Expand", [self.node("Unsqueeze", [latent, self.constant([0])]), every_step])
        bias_name = self.constant(np.concatenate([bias, np.zeros_like(bias)], 1))
        outputs = self.node("LSTM", [inputs, *weight, bias_name, "", *first], hidden_size=hidden)
        return self.node("Squeeze", [outputs, self.constant([1])])

    def poses(self, steps: str) -> None:
        """From LSTM outputs to ``position`` and ``rotation``."""
        weight, bias = self.weights.layer("decoder.head")
        by_plan = self.node("Transpose", [steps], perm=[1, 0, 2])
        numbers = self.node("Add", [self.node("MatMul", [by_plan, self.constant(weight.T)]), self.constant(bias)])
        parts = ["position", "a1", "a2"]
        self.nodes.append(helper.make_node("Split", [numbers, self.constant([3, 3, 3])], parts, axis=-1))
        b1 = self.node("LpNormalization", ["a1"], axis=-1, p=2)
        along = self.node("ReduceSum", [self.node("Mul", [b1, "a2"]), self.constant([-1])], keepdims=1)
        rest = self.node("Sub", ["a2", self.node("Mul", [along, b1])])
        b2 = self.node("LpNormalization", [rest], axis=-1, p=2)
        turned = [
            [self.node("Gather", [axis, self.constant(order)], axis=-1) for order in ([1, 2, 0], [2, 0, 1])]
            for axis in (b1, b2)
        ]
        products = [self.node("Mul", [turned[0][i], turned[1][1 - i]]) for i in range(2)]
        columns = [b1, b2, self.node("Sub", products)]
        wide = [self.node("Unsqueeze", [column, self.constant([-1])]) for column in columns]
        self.node("Concat", wide, "rotation", axis=-1)

    def serialised(self) -> bytes:
        config = self.weights.config
        size, steps = config["image_size"], (self.batch, config["horizon"])
        inputs = [
            helper.make_tensor_value_info(camera, TensorProto.UINT8, (self.batch, size, size, 3))
            for camera in config["cameras"]
        ]
        outputs = [
            helper.make_tensor_value_info("position", TensorProto.FLOAT, (*steps, 3)),
            helper.make_tensor_value_info("rotation", TensorProto.FLOAT, (*steps, 3, 3)),
        ]
        graph = helper.make_graph(self.nodes, "planner", inputs, outputs, self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=9)
        onnx.checker.check_model(model)
        return model.SerializeToString()
