import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from table import Bench


@pytest.fixture(scope="session")
def border(tmp_path_factory) -> Bench:
    """The bench on which odd inputs are tried."""
    return Bench(tmp_path_factory.mktemp("border"))
