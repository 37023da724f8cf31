"""The README's Python example is found, and a README that changed is noticed; `make test-wheel` runs it."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    from try_wheel import example

    return example


def test_the_example_is_found(example, tmp_path: Path) -> None:
    code = example((ROOT / "README.md").read_text(encoding="utf-8"), tmp_path / "tiny.hdf5")
    compile(code, "README.md", "exec")
    assert "episodes=2" in code
    assert "runs/square" not in code


@pytest.mark.parametrize("readme", ["", "```python\n1\n```\n```python\n2\n```\n", "```python\nimport ocplanner\n```\n"])
def test_another_readme_is_noticed(example, tmp_path: Path, readme: str) -> None:
    with pytest.raises(ValueError, match="README"):
        example(readme, tmp_path / "tiny.hdf5")
