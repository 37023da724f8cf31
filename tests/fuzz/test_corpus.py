import random
import sys
import time
import warnings
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from fuzz_core import one_input, random_input
from targets import TARGETS

from ocplanner import _core

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())


@pytest.fixture(autouse=True)
def quiet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy may warn about hostile numbers; MuJoCo writes its log to where it runs."""
    warnings.simplefilter("ignore")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_once_failed_stays_mended(path: Path) -> None:
    one_input(path.read_bytes())


def test_random_calls_give_results_or_errors_of_ours() -> None:
    rng = random.Random(20240)
    end = time.monotonic() + 5
    while time.monotonic() < end:
        data = random_input(rng)
        try:
            one_input(data)
        except BaseException as error:
            raise AssertionError(f"input {data.hex()}") from error


def test_every_public_name_is_fuzzed() -> None:
    names = {name for name in vars(_core) if not name.startswith("_")}
    assert names == set(TARGETS)
