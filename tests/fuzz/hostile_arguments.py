"""Arguments that a caller might pass by mistake or on purpose."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from choices import Choices

SPECIAL_NUMBERS = (0.0, -0.0, np.nan, np.inf, -np.inf, 1.7e308, -1.7e308, 1e200, 5e-324, 1e-200, 1.0, 1e-9, np.pi)
SPECIAL_INTEGERS = (1, 0, 2, 3, 17, -1, 255, 1 << 31, 1 << 40, (1 << 63) - 1, 1 << 64, 1 << 80, -(1 << 63))
NOT_ARRAYS: tuple[Any, ...] = (None, [], [1.0, 2.0], "array", b"bytes", 3, np.nan, {}, np.float64(1), object(), True)
_DTYPES = ("f4", "f2", "i8", "u1", "?", "c16", "O", "U3", ">f8", "M8[s]", "i1", "V8")


def number(choices: Choices, good: float) -> Any:
    """The given float, a special one, or something else."""
    kind = choices.index(8)
    if kind < 4:
        return good
    if kind < 7:
        return choices.pick(SPECIAL_NUMBERS)
    return choices.pick(NOT_ARRAYS)


def integer(choices: Choices, good: int) -> Any:
    """The given int, a special one, or something else."""
    kind = choices.index(8)
    if kind < 5:
        return good
    if kind < 7:
        return choices.pick(SPECIAL_INTEGERS)
    return choices.pick(NOT_ARRAYS)


def array(choices: Choices, good: np.ndarray) -> Any:
    """The array, a changed one, or something else in its place."""
    if choices.index(3) < 2:
        return good
    changed: Any = good
    if choices.chance(2):
        changed = choices.pick(_OF_VALUES)(choices, changed)
    return choices.pick(_OF_FORM)(choices, changed)


def _as_it_is(choices: Choices, value: np.ndarray) -> np.ndarray:
    return value


def _with_special_numbers(choices: Choices, value: np.ndarray) -> np.ndarray:
    value = value.copy()
    if value.dtype.kind == "f" and value.size:
        for _ in range(1 + choices.index(4)):
            with np.errstate(over="ignore"):
                value.flat[choices.index(value.size)] = choices.pick(SPECIAL_NUMBERS)
    return value


def _of_one_number(choices: Choices, value: np.ndarray) -> np.ndarray:
    if value.dtype.kind != "f":
        return value
    with np.errstate(over="ignore"):
        return np.full_like(value, choices.pick(SPECIAL_NUMBERS))


def _of_random_bits(choices: Choices, value: np.ndarray) -> np.ndarray:
    if value.dtype.kind not in "fuib":
        return value
    bits = np.random.default_rng(choices.index(1 << 16)).bytes(value.nbytes)
    return np.frombuffer(bits, value.dtype).reshape(value.shape).copy()


def _of_another_dtype(choices: Choices, value: np.ndarray) -> np.ndarray:
    return np.zeros(value.shape, choices.pick(_DTYPES))


def _in_another_order(choices: Choices, value: np.ndarray) -> np.ndarray:
    if value.ndim == 0:
        return value
    orders: tuple[Callable[[], np.ndarray], ...] = (
        lambda: np.asfortranarray(value),
        lambda: value.T,
        lambda: np.repeat(value, 2, axis=-1)[..., ::2],
        lambda: value[::-1],
        lambda: value[..., ::-1],
        lambda: np.broadcast_to(value[..., :1], value.shape),
    )
    return choices.pick(orders)()


def _unaligned(choices: Choices, value: np.ndarray) -> np.ndarray:
    if value.dtype.kind not in "fui":
        return value
    memory = bytearray(value.nbytes + 8)
    moved = np.frombuffer(memory, value.dtype, value.size, offset=1 + choices.index(7)).reshape(value.shape)
    moved[...] = value
    return moved


def _read_only(choices: Choices, value: np.ndarray) -> np.ndarray:
    value = value.copy()
    value.flags.writeable = False
    return value


def _of_another_shape(choices: Choices, value: np.ndarray) -> np.ndarray:
    shape = list(value.shape)
    match choices.index(5):
        case 0:
            shape.insert(choices.index(len(shape) + 1), choices.index(3))
        case 1 if shape:
            shape.pop(choices.index(len(shape)))
        case 2 if shape:
            shape[choices.index(len(shape))] = 0
        case 3 if shape:
            shape[choices.index(len(shape))] += 1 + choices.index(3)
        case _:
            shape = [1] * choices.index(33) + shape
    return np.zeros(shape[-32:], value.dtype)


def _huge(choices: Choices, value: np.ndarray) -> np.ndarray:
    if choices.chance(8):
        count = max(1, (1 << 22) // max(value.size, 1))
        return np.ascontiguousarray(np.broadcast_to(value, (count, *value.shape)))
    try:
        return np.broadcast_to(value, (1 << choices.pick((20, 40, 55)), *value.shape))
    except ValueError:  # larger than the address space
        return value


def _of_another_class(choices: Choices, value: np.ndarray) -> Any:
    if choices.chance(2):
        return np.ma.masked_invalid(value) if value.dtype.kind == "f" else np.ma.masked_array(value)
    return np.asmatrix(value) if value.ndim == 2 else value.tolist()


def _not_an_array(choices: Choices, value: np.ndarray) -> Any:
    return choices.pick(NOT_ARRAYS)


_Change: TypeAlias = Callable[[Choices, np.ndarray], Any]

_OF_VALUES: tuple[_Change, ...] = (_with_special_numbers, _of_one_number, _of_random_bits)
_OF_FORM: tuple[_Change, ...] = (
    _as_it_is,
    _with_special_numbers,
    _of_another_dtype,
    _in_another_order,
    _unaligned,
    _read_only,
    _of_another_shape,
    _huge,
    _of_another_class,
    _not_an_array,
)
