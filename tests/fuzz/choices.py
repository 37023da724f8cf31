"""A string of bytes read as a sequence of decisions."""

from collections.abc import Sequence
from typing import TypeVar

Item = TypeVar("Item")


class Choices:
    """Decides by consuming bytes. Once they are used up, every decision is the first alternative.

    So the same bytes always make the same call, a few bytes are enough to describe a failure, and mutating the bytes
    mutates the decisions.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def index(self, count: int) -> int:
        """A number in 0..count - 1."""
        size = 1 if count <= 256 else 4
        taken = self._data[self._at : self._at + size]
        self._at += size
        return int.from_bytes(taken, "little") % count

    def pick(self, items: Sequence[Item]) -> Item:
        """One of the items; the first is the harmless one."""
        return items[self.index(len(items))]

    def chance(self, one_in: int) -> bool:
        """True about once in so many times, and False once the bytes are used up."""
        return self.index(one_in) == one_in - 1
