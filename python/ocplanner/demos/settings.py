"""How data sets are read. This module loads neither the simulator nor torch."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ocplanner.errors import DatasetError


@dataclass(frozen=True)
class ReadSettings:
    """How a data set is read; the same for every verb that reads one."""

    skip_bad: bool = False
    """Leave out demonstrations that cannot be used, and say why; otherwise they are an error that names them all."""
    keys: Path | None = None
    """JSON file that maps our names of observations to the file's, such as {"robot0_eef_pos": "ee_pos"}."""

    @cached_property
    def names(self) -> dict[str, str]:
        """Our names of observations -> the file's.

        Raises:
            DatasetError: the file with the names cannot be read.
        """
        if self.keys is None:
            return {}
        remedy = 'write an object of texts, such as {"robot0_eef_pos": "ee_pos"}'
        try:
            names = json.loads(self.keys.read_text(encoding="utf-8"))
        except OSError as error:
            raise DatasetError(f"cannot read {self.keys}: {error.strerror}; give the path of a JSON file") from error
        except ValueError as error:
            raise DatasetError(f"{self.keys}: the names of observations cannot be read ({error}); {remedy}") from error
        if not isinstance(names, dict) or not all(isinstance(name, str) for name in names.values()):
            raise DatasetError(f"{self.keys}: no object of texts; {remedy}")
        return names


DEFAULT_READING = ReadSettings()
