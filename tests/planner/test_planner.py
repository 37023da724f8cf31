import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import MISSING, FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file, save_file

from ocplanner.errors import InvalidValueError, MismatchError, ModelFileError, ShapeError, UnknownNameError
from ocplanner.files.records.planner import PlannerHeader
from ocplanner.planner.planner import Plan, Planner
from random_planner import planner_config, random_images, random_tensors, write_planner, write_random_planner
from torch_reference import reference

SMALL = {"type": "small", "channels": [16, 32, 64, 128], "pool": "spatial_softmax", "keypoints": 32, "feature": 64}
RESNET = {"type": "resnet18", "pool": "spatial_softmax", "keypoints": 32, "feature": 64}
TOLERANCE = 1e-5

CASES = {
    "small": {"encoder": SMALL, "horizon": 20, "decoder": {"hidden": 256}, "latent": 32},
    "small, flatten": {"encoder": {**SMALL, "pool": "flatten"}, "horizon": 5},
    "small, position": {"encoder": SMALL, "outputs": "position", "horizon": 50},
    "small, two cameras, three modes": {
        "encoder": {**SMALL, "feature_relu": True},
        "cameras": ["agentview", "robot0_eye_in_hand"],
        "modes": 3,
    },
    "odd shapes": {
        "encoder": {"type": "small", "channels": [5, 19, 33], "pool": "spatial_softmax", "keypoints": 7, "feature": 11}
        | {"temperature": 0.7},
        "cameras": ["a", "b"],
        "image_size": 53,
        "crop": 46,
        "latent": 9,
        "modes": 2,
        "predictor": {"hidden": [21, 35]},
        "decoder": {"hidden": 23},
        "horizon": 7,
    },
    "odd shapes, flatten": {
        "encoder": {"type": "small", "channels": [7, 18], "pool": "flatten", "feature": 3},
        "image_size": 31,
        "crop": 31,
        "predictor": {"hidden": []},
        "decoder": {"hidden": 5},
        "horizon": 1,
    },
    "resnet18, h 5": {"encoder": RESNET, "horizon": 5, "decoder": {"hidden": 256}},
    "resnet18, h 20": {"encoder": RESNET, "horizon": 20, "outputs": "position"},
    "resnet18, h 50": {"encoder": RESNET, "horizon": 50, "decoder": {"hidden": 400}, "latent": 32},
    "resnet18, flatten, 84": {"encoder": {**RESNET, "pool": "flatten"}, "crop": 84},
    "resnet18, odd size": {"encoder": RESNET, "image_size": 60, "crop": 51},
}


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def check(planner: Planner, config: dict, tensors: dict[str, np.ndarray], batch: int) -> None:
    images = random_images(config, batch, seed=batch)
    expected = reference(config, tensors, images)
    modes = planner.plan_modes(images)
    assert relative(modes.position, expected["position"]) < TOLERANCE
    assert np.abs(modes.probability - expected["probability"]).max() < TOLERANCE
    best = expected["probability"].argmax(1)
    rows = np.arange(batch)
    plan = planner.plan(images)
    assert relative(plan.position, expected["position"][rows, best]) < TOLERANCE
    assert relative(planner.encode(images), expected["latent"][rows, best]) < TOLERANCE
    np.testing.assert_allclose(plan.position, modes.position[rows, best], rtol=0, atol=1e-6)
    if config["outputs"] == "pose":
        assert modes.rotation is not None
        assert relative(modes.rotation, expected["rotation"]) < TOLERANCE
    else:
        assert modes.rotation is None
        assert plan.rotation is None


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("batch", [1, 19])
def test_agrees_with_torch(tmp_path: Path, case: str, batch: int) -> None:
    config = planner_config(**CASES[case])
    tensors = random_tensors(config, seed=3)
    if config["encoder"]["type"] == "resnet18":
        # Torch takes its time in float64; from 5 images on every layer that can uses Winograd's transforms.
        batch = min(batch, 9)
    check(Planner.load(write_planner(tmp_path / "p.safetensors", config, tensors)), config, tensors, batch)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    channels=st.lists(st.integers(1, 40), min_size=1, max_size=4),
    pool=st.sampled_from(["spatial_softmax", "flatten"]),
    sizes=st.tuples(*[st.integers(1, 40)] * 5),
    crop=st.integers(1, 40),
    margin=st.integers(0, 9),
    modes=st.integers(1, 4),
    cameras=st.integers(1, 3),
    batch=st.integers(1, 20),
    seed=st.integers(0, 99),
)
def test_agrees_with_torch_on_any_shape(
    tmp_path: Path, channels, pool, sizes, crop, margin, modes, cameras, batch, seed
) -> None:
    keypoints, feature, latent, hidden, decoder = sizes
    encoder = {"type": "small", "channels": channels, "pool": pool, "keypoints": keypoints, "feature": feature}
    config = planner_config(
        encoder=encoder,
        image_size=crop + margin,
        crop=crop,
        modes=modes,
        cameras=[f"camera{i}" for i in range(cameras)],
        latent=latent,
        predictor={"hidden": [hidden]},
        decoder={"hidden": decoder},
    )
    tensors = random_tensors(config, seed)
    planner = Planner.load(write_planner(tmp_path / "p.safetensors", config, tensors))
    images = random_images(config, batch, seed)
    expected = reference(config, tensors, images)
    plan = planner.plan_modes(images)
    assert plan.position.shape == (batch, modes, config["horizon"], 3)
    assert relative(plan.position, expected["position"]) < TOLERANCE
    assert plan.rotation is not None
    # A nearly degenerate 6-D rotation magnifies rounding, so compare the rotations as a whole.
    assert relative(plan.rotation, expected["rotation"]) < 10 * TOLERANCE


@pytest.mark.parametrize("level", ["avx2", "portable"])
def test_lower_instruction_sets_agree(tmp_path: Path, level: str) -> None:
    path = tmp_path / "p.safetensors"
    for case in ("odd shapes", "small", "resnet18, h 5"):
        config = write_random_planner(path, seed=3, **CASES[case])
        plan = Planner.load(path).plan(random_images(config, 7))
        np.save(tmp_path / "images.npy", np.stack(list(random_images(config, 7).values())))
        code = (
            "import numpy as np; from ocplanner import Planner, _core\n"
            f"planner = Planner.load({str(path)!r}); images = np.load({str(tmp_path / 'images.npy')!r})\n"
            "plan = planner.plan(dict(zip(planner.header.cameras, images)))\n"
            f"np.save({str(tmp_path / 'plan.npy')!r}, plan.position); print(_core.simd_level())"
        )
        environment = {**os.environ, "OCPLANNER_SIMD": level}
        run = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
        assert run.stdout.split() in (["portable"], [level])
        assert relative(np.load(tmp_path / "plan.npy"), plan.position) < TOLERANCE


def bf16_moves(path: Path, config: dict) -> float:
    images = random_images(config, 5)
    exact, rounded = Planner.load(path).plan(images), Planner.load(path, storage="bf16").plan(images)
    return relative(rounded.position, exact.position)


def test_bf16_storage_moves_a_plan_little(tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    config = write_random_planner(path, seed=3, **CASES["resnet18, h 5"])
    assert 0 < bf16_moves(path, config) < 0.01


def test_bf16_storage_leaves_layers_that_fit_the_cache(tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    config = write_random_planner(path, seed=3, **CASES["small, flatten"])
    assert bf16_moves(path, config) == 0


@pytest.mark.parametrize("batch", [0, 1, 16, 17, 40])
def test_batches_and_threads_do_not_change_plans(tmp_path: Path, batch: int) -> None:
    config = write_random_planner(tmp_path / "p.safetensors", modes=2)
    planner = Planner.load(tmp_path / "p.safetensors")
    images = random_images(config, batch)
    whole = planner.plan(images)
    assert whole.position.shape == (batch, config["horizon"], 3)
    assert whole.probability.shape == (batch,)
    dealt = planner.plan(images, threads=3)
    for found, expected in zip(dealt, whole):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    for i in range(batch):
        single = planner.plan({name: array[i : i + 1] for name, array in images.items()})
        np.testing.assert_allclose(single.position[0], whole.position[i], rtol=0, atol=1e-6)


@pytest.mark.parametrize("outputs", ["pose", "position"])
@pytest.mark.parametrize("steps", [1, 2, 6])
def test_the_first_steps_do_not_need_the_rest(tmp_path: Path, outputs: str, steps: int) -> None:
    config = write_random_planner(tmp_path / "p.safetensors", outputs=outputs, horizon=6)
    planner = Planner.load(tmp_path / "p.safetensors")
    images = random_images(config, 18)
    whole, first = planner.plan(images), planner.plan(images, steps=steps)
    assert first.position.shape == (18, steps, 3)
    np.testing.assert_allclose(first.position, whole.position[:, :steps], rtol=0, atol=1e-6)
    np.testing.assert_allclose(first.probability, whole.probability, rtol=0, atol=1e-6)
    if whole.rotation is None:
        assert first.rotation is None
    else:
        np.testing.assert_allclose(first.rotation, whole.rotation[:, :steps], rtol=0, atol=1e-5)


@pytest.mark.parametrize("steps", [0, 7])
def test_steps_beyond_the_horizon_are_an_error(tmp_path: Path, steps: int) -> None:
    config = write_random_planner(tmp_path / "p.safetensors", horizon=6)
    with pytest.raises(InvalidValueError, match=f"found {steps} with a horizon of 6"):
        Planner.load(tmp_path / "p.safetensors").plan(random_images(config, 1), steps=steps)


def test_threads_may_share_a_planner(tmp_path: Path) -> None:
    config = write_random_planner(tmp_path / "p.safetensors")
    planner = Planner.load(tmp_path / "p.safetensors")
    images = [random_images(config, 1 + seed % 3, seed) for seed in range(32)]
    alone = [planner.plan(batch).position for batch in images]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda batch: planner.plan(batch).position, images))
    for found, expected in zip(together, alone):
        np.testing.assert_array_equal(found, expected)


def test_describes_itself(tmp_path: Path) -> None:
    config = write_random_planner(tmp_path / "p.safetensors")
    planner = Planner.load(str(tmp_path / "p.safetensors"))
    assert planner.header == PlannerHeader.from_json(json.dumps(config))
    assert planner.path == tmp_path / "p.safetensors"
    assert len(planner.sha256) == 64
    assert "horizon=6" in repr(planner)
    with pytest.raises(FrozenInstanceError):
        planner.header.horizon = 3  # type: ignore[misc]


def test_images_are_checked(tmp_path: Path) -> None:
    config = write_random_planner(tmp_path / "p.safetensors", cameras=["agentview", "side"])
    planner = Planner.load(tmp_path / "p.safetensors")
    good = random_images(config, 2)
    with pytest.raises(MismatchError, match=r"agentview, side; missing: side; given: agentview"):
        planner.plan({"agentview": good["agentview"]})
    with pytest.raises(MismatchError, match="images is a ndarray, expected a dictionary"):
        planner.plan(good["agentview"])  # type: ignore[arg-type]
    bad = {
        "float32": good["side"].astype(np.float32),
        "found dtype int8": good["side"].astype(np.int8),
        r"\[2, 83, 84, 3\]": good["side"][:, :83].copy(),
        r"\[84, 84, 3\]": good["side"][0],
        r"\[1, 2, 84, 84, 3\]": good["side"][None],
        "memory order": good["side"][:, :, ::-1],
        "memory": np.asfortranarray(good["side"]),
        "1 images, but agentview has 2": good["side"][:1],
        "found list": good["side"].tolist(),
        "found NoneType": None,
    }
    for message, array in bad.items():
        with pytest.raises(ShapeError, match=message) as info:
            planner.plan({"agentview": good["agentview"], "side": array})  # type: ignore[dict-item]
        assert "side" in str(info.value)
    assert isinstance(planner.plan({**good, "unused": np.zeros(3, np.uint8)}), Plan)


def damage_cases() -> dict[str, str]:
    return {
        "nothing": "HeaderTooSmall|header",
        "cut": "incomplete|header",
        "huge header": "[Hh]eader",
        "text": "[Hh]eader",
        "no metadata": "ocplanner",
        "not JSON": "not JSON",
        "kind": "policy file, not a planner",
        "format": "format",
        "missing tensor": "predictor.0.weight is missing",
        "surplus tensor": "surplus",
        "wrong shape": r"predictor.0.bias: shape is \[3\], expected \[48\]",
        "wrong dtype": "dtype is F64, expected F32",
        "NaN": "value 1 is NaN",
        "infinite": "value 1 is inf",
        "no horizon": "horizon",
        "no task": "task is missing",
        "horizon 0": "horizon is 0",
        "latent huge": "latent is",
        "crop": "crop 90",
        "no cameras": "cameras is empty",
        "std": "normaliser",
        "encoder": "vgg",
        "no keypoints": "keypoints",
        "no channels": "channels is empty",
        "outputs": "velocity",
    }


@pytest.mark.parametrize("damage", damage_cases())
def test_damaged_files_are_refused(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "p.safetensors"
    config = planner_config()
    encoder = config["encoder"]
    changes = {
        "horizon 0": {"horizon": 0},
        "latent huge": {"latent": 1 << 60},
        "crop": {"crop": 90},
        "no cameras": {"cameras": []},
        "std": {"normaliser": {"mean": [0, 0, 0], "std": [1, 0, 1]}},
        "encoder": {"encoder": {**encoder, "type": "vgg"}},
        "no keypoints": {"encoder": {**encoder, "keypoints": 0}},
        "no channels": {"encoder": {**encoder, "channels": []}},
        "outputs": {"outputs": "velocity"},
    }
    tensors = random_tensors(config)
    config.update(changes.get(damage, {}))
    if damage in ("no horizon", "no task"):
        del config[damage.removeprefix("no ")]
    if damage == "missing tensor":
        del tensors["predictor.0.weight"]
    if damage == "surplus tensor":
        tensors["surplus"] = np.zeros(2, np.float32)
    if damage == "wrong shape":
        tensors["predictor.0.bias"] = np.zeros(3, np.float32)
    if damage == "wrong dtype":
        tensors["predictor.0.bias"] = np.zeros(48, np.float64)
    if damage in ("NaN", "infinite"):
        tensors["predictor.0.bias"][1] = np.nan if damage == "NaN" else np.inf
    description = {"kind": {"kind": "policy"}, "format": {"format": 2}}.get(damage, {})
    write_planner(path, config, tensors, **description)
    if damage == "no metadata":
        save_file(tensors, path)
    if damage == "not JSON":
        save_file(tensors, path, metadata={"ocplanner": "{"})
    whole = path.read_bytes()
    replaced = {
        "nothing": b"",
        "cut": whole[: len(whole) // 2],
        "huge header": (1 << 62).to_bytes(8, "little") + whole[8:],
        "text": b"PK\x03\x04 a pickled checkpoint, perhaps",
    }
    path.write_bytes(replaced.get(damage, whole))
    with pytest.raises(ModelFileError, match=damage_cases()[damage]) as info:
        Planner.load(path)
    assert str(path) in str(info.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"nowhere.safetensors: cannot be read"):
        Planner.load(tmp_path / "nowhere.safetensors")
    with pytest.raises(ModelFileError, match="cannot be read"):
        Planner.load(tmp_path)


def test_a_run_folder_stands_for_its_planner(tmp_path: Path) -> None:
    write_random_planner(tmp_path / "planner.safetensors")
    assert Planner.load(tmp_path).path == tmp_path / "planner.safetensors"


def test_unknown_storage_is_named(tmp_path: Path) -> None:
    write_random_planner(tmp_path / "p.safetensors")
    with pytest.raises(UnknownNameError, match=r"f16.*bf16, f32"):
        Planner.load(tmp_path / "p.safetensors", storage="f16")  # type: ignore[arg-type]


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_mutated_files_load_or_are_refused(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Random damage to the header never crashes the loader."""
    path = tmp_path_factory.getbasetemp() / "mutated.safetensors"
    encoder = {"type": "small", "channels": [2], "pool": "flatten", "feature": 2}
    sizes = {"latent": 2, "predictor": {"hidden": []}, "decoder": {"hidden": 2}, "image_size": 4, "crop": 4}
    write_random_planner(path, encoder=encoder, **sizes)
    content = bytearray(path.read_bytes())
    header = int.from_bytes(content[:8], "little")
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, header + 7))] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(content))
    try:
        planner = Planner.load(path)
    except ModelFileError:
        return
    json.loads(planner.header.metadata()["ocplanner"])


TRAINED = sorted((Path(__file__).parents[2] / "results").rglob("planners/*.safetensors"))


@pytest.mark.parametrize("path", TRAINED, ids=lambda path: path.stem)
def test_agrees_with_torch_on_trained_weights(path: Path) -> None:
    planner = Planner.load(path)
    check(planner, json.loads(planner.engine.config_json), load_file(path), batch=19)


def test_there_are_trained_planners() -> None:
    assert TRAINED


@pytest.mark.parametrize(
    "name",
    [
        name
        for name, f in PlannerHeader.__dataclass_fields__.items()
        if f.default is MISSING and f.default_factory is MISSING
    ],
)
def test_a_header_that_lacks_a_field_names_it(tmp_path: Path, name: str) -> None:
    config = planner_config()
    tensors = random_tensors(config)
    del config[name]
    with pytest.raises(ModelFileError, match=rf"p\.safetensors: .*({name} is missing|missing field `{name}`)"):
        Planner.load(write_planner(tmp_path / "p.safetensors", config, tensors))


@pytest.mark.parametrize(("number", "said"), [(99, "99"), ("x", '"x"'), (None, "null")])
def test_another_format_is_told_plainly(tmp_path: Path, number: object, said: str) -> None:
    config = planner_config()
    path = write_planner(tmp_path / "p.safetensors", config, random_tensors(config), format=number)
    with pytest.raises(ModelFileError, match=f"its format is {said}, this version of ocplanner reads 1; update"):
        Planner.load(path)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused(tmp_path: Path, value: float) -> None:
    config = planner_config()
    tensors = random_tensors(config)
    tensors["decoder.head.bias"][1] = value
    with pytest.raises(ModelFileError, match=r"tensor decoder\.head\.bias: value 1 is"):
        Planner.load(write_planner(tmp_path / "p.safetensors", config, tensors))


def test_pictures_of_nan_are_refused(tmp_path: Path) -> None:
    config = write_random_planner(tmp_path / "p.safetensors")
    pictures = {camera: np.full((1, 84, 84, 3), np.nan) for camera in config["cameras"]}
    with pytest.raises(ShapeError, match=r"uint8, found dtype float64"):
        Planner.load(tmp_path / "p.safetensors").plan(pictures)
