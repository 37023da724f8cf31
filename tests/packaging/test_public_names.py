"""What type checkers see is what ``import ocplanner`` gives."""

import ast
from pathlib import Path

import pytest

import ocplanner

STUB = Path(__file__).parents[2] / "python" / "ocplanner" / "__init__.pyi"


def names_of(stub: str) -> dict[str, str]:
    """Each exported name and the module it comes from."""
    return {
        alias.asname: node.module
        for node in ast.parse(stub).body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
        if alias.asname == alias.name
    }


def test_the_stub_lists_the_lazy_names():
    assert names_of(STUB.read_text()) == ocplanner._LAZY
    assert sorted(ocplanner.__all__) == dir(ocplanner) == sorted(ocplanner._LAZY)


@pytest.mark.parametrize("name", ocplanner.__all__)
def test_every_name_is_there(name):
    assert callable(getattr(ocplanner, name))


def test_another_name_is_not():
    with pytest.raises(AttributeError, match="no attribute 'Planers'"):
        _ = ocplanner.Planers  # type: ignore[attr-defined]
