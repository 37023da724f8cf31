"""The packages that users install: each is used, and CONTRIBUTING says what for."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
IMPORTED_AS = {
    "imageio-ffmpeg": "imageio_ffmpeg",
    "fast-simplification": "fast_simplification",
    "lightning-fabric": "lightning_fabric",
    "pillow": "PIL",
    "pyyaml": "yaml",
    "scikit-learn": "sklearn",
    "tensorboard": "torch.utils.tensorboard",
}
DEPENDENCIES = [
    re.split(r"[<>=!~\[ ]", requirement)[0]
    for requirement in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
]


@pytest.fixture(scope="module")
def sources() -> str:
    return "\n".join(path.read_text() for path in (ROOT / "python").rglob("*.py"))


@pytest.mark.parametrize("package", DEPENDENCIES)
def test_a_dependency_is_imported(sources, package):
    module = re.escape(IMPORTED_AS.get(package, package))
    assert re.search(rf"""^\s*(import|from) {module}\b|import_module\("{module}"\)""", sources, flags=re.MULTILINE)


@pytest.mark.parametrize("package", DEPENDENCIES)
def test_contributing_says_what_a_dependency_is_for(package):
    first_column = [line.split("|")[1] for line in (ROOT / "CONTRIBUTING.md").read_text().splitlines() if "|" in line]
    assert any(package in re.split(r"[, ]+", cell) for cell in first_column)
