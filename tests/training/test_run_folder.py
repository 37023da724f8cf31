"""Run folders: damage is told, and nothing but what was asked for is left in them."""

import json

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from ocplanner.errors import TrainingError
from ocplanner.files.records.metrics import RunConfig, StepMetrics
from ocplanner.training.run_folder import RunFolder

TENSORS = {
    "network.weight": torch.arange(6.0).reshape(2, 3),
    "steps": torch.tensor(3),
    "none": torch.zeros(0, 2),
    "half": torch.ones(5, dtype=torch.bfloat16),
}
FACTS = {"stage": "vae", "step": 3, "seconds": 0.1}


def test_a_checkpoint_comes_back(tmp_path):
    folder = RunFolder(tmp_path / "run")
    folder.save("latest", TENSORS, FACTS)
    loaded = folder.load("latest")
    assert loaded is not None
    tensors, facts = loaded
    assert facts == FACTS
    assert tensors.keys() == TENSORS.keys()
    assert all(torch.equal(tensors[key], value) for key, value in TENSORS.items())
    assert [path.name for path in (tmp_path / "run" / "checkpoints").iterdir()] == ["latest.safetensors"]


def test_every_changed_byte_is_told(tmp_path):
    folder = RunFolder(tmp_path)
    folder.save("latest", TENSORS, FACTS)
    path = tmp_path / "checkpoints" / "latest.safetensors"
    content = path.read_bytes()
    payload = sum(tensor.nbytes for tensor in TENSORS.values())
    in_facts = content.index(b'step\\": 3') + len(b'step\\": ')
    for place in (in_facts, *range(len(content) - payload, len(content))):
        changed = bytearray(content)
        changed[place] ^= 1
        path.write_bytes(changed)
        with pytest.raises(
            TrainingError, match=r"latest\.safetensors is damaged \(its checksum is wrong\); remove .*checkpoints to"
        ):
            folder.load("latest")


def test_a_checkpoint_of_an_older_version_has_no_checksum(tmp_path):
    folder = RunFolder(tmp_path)
    path = tmp_path / "checkpoints" / "latest.safetensors"
    save_file(TENSORS, path, metadata={"facts": json.dumps(FACTS)})
    with safe_open(path, framework="pt") as file:
        assert "sha256" not in file.metadata()["facts"]
    loaded = folder.load("latest")
    assert loaded is not None
    assert loaded[1] == FACTS


@pytest.mark.parametrize("metadata", [None, {}, {"facts": "[]"}, {"facts": "null"}, {"facts": "{"}, {"facts": "1"}])
def test_hostile_facts_are_refused(tmp_path, metadata):
    folder = RunFolder(tmp_path)
    save_file(TENSORS, tmp_path / "checkpoints" / "latest.safetensors", metadata=metadata)
    with pytest.raises(TrainingError, match=r"latest\.safetensors is damaged"):
        folder.load("latest")


@pytest.mark.parametrize("content", [b"\xff\xfe", b"- 1\n- 2\n", b"a: [1", b"word"])
def test_a_damaged_configuration_is_named(tmp_path, content):
    (tmp_path / "config.yaml").write_bytes(content)
    with pytest.raises(TrainingError, match=r"config\.yaml is damaged \(.*\); remove the run folder"):
        RunFolder(tmp_path).claim(RunConfig({"seed": 0}))
    assert (tmp_path / "config.yaml").read_bytes() == content


def test_rows_stay_only_with_a_checkpoint(tmp_path):
    folder = RunFolder(tmp_path)
    folder.record(StepMetrics("vae", 3, {"loss": 0.5}))
    folder.close()
    folder.claim(RunConfig({"seed": 0}))
    assert folder.rows() == []
    folder.record(StepMetrics("vae", 3, {"loss": 0.5}))
    folder.close()
    folder.save("latest", TENSORS, FACTS)
    folder.claim(RunConfig({"seed": 0}))
    assert len(folder.rows()) == 1
