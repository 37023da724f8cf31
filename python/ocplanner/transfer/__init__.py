"""Zero-shot transfer: grasp, then make the object follow the plan.

The package is callable: ``ocplanner.transfer(planner, robot="Sawyer")`` is
:func:`ocplanner.transfer.loop.transfer`.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ocplanner.transfer.result import TransferResult


class _Transfer(ModuleType):
    """A package that runs its main function when called, so that one name serves ``ocp.transfer(...)`` and imports."""

    def __call__(self, *arguments: Any, **options: Any) -> "TransferResult":
        """See :func:`ocplanner.transfer.loop.transfer`."""
        from ocplanner.transfer.loop import transfer

        return transfer(*arguments, **options)


sys.modules[__name__].__class__ = _Transfer
