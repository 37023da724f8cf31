"""Nothing that a file holds is executed: SECURITY.md lists where pickles are read, and there is no other place."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "python" / "ocplanner"
ALLOWED = {"rollouts/ray_pool.py": {"pickle.loads"}}
"""What SECURITY.md lists."""
MODULES = ("pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "marshal", "shelve")
READING = ("load", "loads", "Unpickler", "open")
CALLS = {f"{module}.{name}" for module in MODULES for name in READING} | {
    *("eval", "exec", "compile", "__import__"),
    *("yaml.load", "yaml.load_all", "yaml.full_load", "yaml.unsafe_load", "yaml.unsafe_load_all"),
}


def dangerous_calls(source: str) -> Iterator[str]:
    """The calls that can execute what they read, under the names by which the module imported them."""
    tree = ast.parse(source)
    names = dict(_imported(tree))
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = _dotted(node.func, names)
        given = {word.arg: getattr(word.value, "value", None) for word in node.keywords}
        unsafe_torch = called in ("torch.load", "torch.serialization.load") and given.get("weights_only") is not True
        unsafe_numpy = called == "numpy.load" and given.get("allow_pickle", False) is not False
        if called in CALLS or unsafe_torch or unsafe_numpy:
            yield called


def _imported(tree: ast.AST) -> Iterator[tuple[str, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                yield (name.asname, name.name) if name.asname else (name.name.partition(".")[0],) * 2
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for name in node.names:
                yield name.asname or name.name, f"{node.module}.{name.name}"


def _dotted(node: ast.expr, names: dict[str, str]) -> str:
    if isinstance(node, ast.Name):
        return names.get(node.id, node.id)
    return f"{_dotted(node.value, names)}.{node.attr}" if isinstance(node, ast.Attribute) else "?"


def test_only_the_listed_places_unpickle() -> None:
    found = {
        path.relative_to(PACKAGE).as_posix(): calls
        for path in sorted(PACKAGE.rglob("*.py"))
        if (calls := set(dangerous_calls(path.read_text(encoding="utf-8"))))
    }
    assert found == ALLOWED


def test_security_lists_the_places() -> None:
    text = (PACKAGE.parents[1] / "SECURITY.md").read_text(encoding="utf-8")
    assert all(f"`{path}`" in text for path in ALLOWED)


@pytest.mark.parametrize(
    "source",
    [
        "import torch\ntorch.load(path)",
        "import torch\ntorch.load(path, weights_only=False)",
        "from torch import load\nload(path)",
        "import pickle as p\np.loads(data)",
        "from yaml import load\nload(text, Loader=Loader)",
        "import numpy as np\nnp.load(path, allow_pickle=True)",
        "eval(text)",
        "def f():\n    import joblib\n    return joblib.load(path)",
    ],
)
def test_a_dangerous_call_is_found(source: str) -> None:
    assert list(dangerous_calls(source))


@pytest.mark.parametrize(
    "source",
    [
        "import torch\ntorch.load(path, weights_only=True)",
        "import yaml\nyaml.safe_load(text)",
        "network.eval()",
        "import numpy as np\nnp.load(path)",
        "import json\njson.loads(text)",
    ],
)
def test_a_harmless_call_is_not(source: str) -> None:
    assert not list(dangerous_calls(source))
