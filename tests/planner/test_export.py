import itertools
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import load_file

from ocplanner import _core
from ocplanner.errors import TrainingError
from ocplanner.planner.augment import to_input
from ocplanner.planner.config import EncoderConfig, preset
from ocplanner.planner.export import Provenance, export_planner, folded, planner_tensors
from ocplanner.planner.network import Normaliser, PlannerNetwork
from torch_reference import reference

ENCODERS = {
    "small-flatten": EncoderConfig(),
    "small-softmax-relu": EncoderConfig(channels=(8, 16), pool="spatial_softmax", feature_relu=True, temperature=0.5),
    "small-plain": EncoderConfig(batch_norm=False),
    "resnet18": EncoderConfig(type="resnet18", pool="spatial_softmax"),
    "resnet18-flatten": EncoderConfig(type="resnet18", pool="flatten"),
}


def trained_looking(config) -> PlannerNetwork:
    """A network whose normalisation statistics and weights are all away from their initial values."""
    torch.manual_seed(3)
    network = PlannerNetwork(config.network, config.cameras)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.normal_(module.bias, std=0.2)
            module.running_mean.normal_(std=0.2)
            module.running_var.uniform_(0.5, 2.0)
    return network.eval()


def probe(batch: int, cameras: tuple[str, ...] = ("agentview",)) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    return {camera: rng.integers(0, 256, (batch, 84, 84, 3), dtype=np.uint8) for camera in cameras}


def header(path: Path) -> dict:
    with safe_open(path, framework="numpy") as file:
        return json.loads(file.metadata()["ocplanner"])


@pytest.fixture
def provenance(settings) -> Provenance:
    return Provenance(
        settings, Normaliser(np.array([0.1, 0.2, 0.9]), np.full(3, 0.1)), "predictor", {"source": {"ade_mm": 1.0}}, "0"
    )


@pytest.mark.parametrize(
    ("encoder", "modes", "outputs", "cameras"),
    [
        ("small-flatten", 1, "pose", 1),
        ("small-flatten", 3, "position", 2),
        ("small-softmax-relu", 1, "position", 1),
        ("small-softmax-relu", 3, "pose", 2),
        ("small-plain", 1, "pose", 1),
        ("resnet18", 1, "pose", 1),
        ("resnet18-flatten", 3, "position", 1),
    ],
)
def test_the_file_plans_as_the_network(tiny, provenance, tmp_path, encoder, modes, outputs, cameras):
    base = tiny(cameras=("agentview", "robot0_eye_in_hand")[:cameras])
    config = replace(base, network=replace(base.network, modes=modes, outputs=outputs, encoder=ENCODERS[encoder]))
    network = trained_looking(config)
    images, path = probe(3, config.cameras), tmp_path / "planner.safetensors"
    export_planner(network, config, provenance, path, images)
    with torch.inference_mode():
        numbers = network({camera: to_input(image, 76) for camera, image in images.items()}).numpy()
    expected, turned = provenance.normaliser.decode(numbers)
    found = reference(header(path)["config"], load_file(path), images)
    best = found["probability"].argmax(axis=1)
    assert found["position"].shape == (3, modes, 5, 3)
    np.testing.assert_allclose(found["position"][range(3), best], expected, rtol=1e-5, atol=1e-5)
    assert (turned is None) == (outputs == "position")
    if turned is not None:
        np.testing.assert_allclose(found["rotation"][range(3), best], turned, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("horizon", [5, 20, 50])
def test_the_cpu_preset_stays_below_five_megabytes(provenance, tmp_path, horizon):
    config = preset("cpu")
    config = replace(config, network=replace(config.network, horizon=horizon))
    path = tmp_path / "planner.safetensors"
    export_planner(trained_looking(config), config, provenance, path, probe(1))
    assert path.stat().st_size < 5_000_000


def test_metadata(tiny, provenance, tmp_path):
    config = tiny()
    path = tmp_path / "planner.safetensors"
    export_planner(trained_looking(config), config, provenance, path, probe(1))
    about = header(path)
    assert (about["format"], about["kind"]) == (1, "planner")
    found = about["config"]
    assert found["task"] == "Square"
    assert found["object"] == "SquareNut"
    assert found["mask_rgb"] == [255, 0, 255]
    assert found["normaliser"] == {"mean": [0.1, 0.2, 0.9], "std": [0.1, 0.1, 0.1]}
    assert found["encoder"] == {
        "type": "small",
        "channels": [4, 8, 8, 8],
        "pool": "flatten",
        "feature": 8,
        "feature_relu": False,
    }


def test_tensor_names_and_shapes(tiny):
    config = tiny()
    tensors = planner_tensors(trained_looking(config))
    shapes = {name: tuple(tensor.shape) for name, tensor in tensors.items()}
    assert shapes["encoder.agentview.conv.0.weight"] == (4, 3, 3, 3)
    assert shapes["encoder.agentview.fc.weight"] == (8, 8 * 5 * 5)
    assert shapes["predictor.1.weight"] == (2 * 4, 16)
    assert shapes["decoder.init.weight"] == (2 * 16, 4)
    assert shapes["decoder.lstm.bias"] == (4 * 16,)
    assert {tensor.dtype for tensor in tensors.values()} == {torch.float32}
    assert all(a.data_ptr() != b.data_ptr() for a, b in itertools.combinations(tensors.values(), 2))


def test_resnet18_tensor_names(tiny):
    base = tiny()
    config = replace(base, network=replace(base.network, encoder=ENCODERS["resnet18"]))
    names = {
        n.removeprefix("encoder.agentview.")
        for n in planner_tensors(trained_looking(config))
        if n.startswith("encoder")
    }
    convolutions = {"stem", "keypoints"} | {
        f"layer{i}.{b}.conv{c}" for i in (1, 2, 3, 4) for b in (0, 1) for c in (1, 2)
    }
    convolutions |= {f"layer{i}.0.downsample" for i in (2, 3, 4)}
    assert names == {f"{name}.{part}" for name in (*convolutions, "fc") for part in ("weight", "bias")}


def test_folding_equals_normalising():
    torch.manual_seed(0)
    conv, norm = torch.nn.Conv2d(3, 5, 3, bias=False), torch.nn.BatchNorm2d(5).eval()
    norm.running_mean.normal_()
    norm.running_var.uniform_(0.1, 3)
    x = torch.rand(2, 3, 8, 8)
    weight, bias = folded(conv, norm)
    torch.testing.assert_close(torch.nn.functional.conv2d(x, weight, bias), norm(conv(x)), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_file_from_which_the_engine_plans_differently_is_not_written(tiny, provenance, tmp_path, monkeypatch, part):
    config = tiny()

    class Engine:
        def __init__(self, data: bytes) -> None:
            self._engine = _core.PlannerEngine(data)

        def plan(self, images: list[np.ndarray], all_modes: bool) -> list[np.ndarray]:
            parts = list(self._engine.plan(images, all_modes=all_modes))
            parts[part] = parts[part] + 0.01
            return parts

    monkeypatch.setattr("ocplanner.planner.export._core", SimpleNamespace(PlannerEngine=Engine))
    with pytest.raises(TrainingError, match="differs from the trained network by 0"):
        export_planner(trained_looking(config), config, provenance, tmp_path / "p", probe(1))
    assert not (tmp_path / "p").exists()
