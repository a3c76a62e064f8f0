"""Straight-line code over vectors of parameter sets, for filters whose sizes are known.

A compiler turns nested loops over small matrices into vector instructions only in part: what it
spends on indices is several times what it spends on numbers.  So the innermost steps of a filter
are emitted as what they are, one vector instruction after the other, each over the `LANES`
parameter sets in the last axis of its arrays.

A step is a Python function that is called while a filter is compiled: :func:`emitted` hands it
sizes as integers and arrays as :class:`Table`, and its arithmetic becomes code.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Self

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic
from numpy.typing import NDArray

__all__ = ["LANES", "Choice", "Shared", "Table", "Vector", "emitted", "plus", "products"]

LANES = 8
"""Parameter sets in a vector, as many as AVX-512 has; a narrower machine takes several turns."""

_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(64)
_FUSED = ("contract",)


class Vector:
    """A number for each lane, in a register of the code that is emitted."""

    def __init__(self, builder: Any, value: Any) -> None:
        self._builder, self.value = builder, value

    def __add__(self, other: Vector) -> Vector:
        return Vector(self._builder, self._builder.fadd(self.value, other.value, flags=_FUSED))

    def __sub__(self, other: Vector) -> Vector:
        return Vector(self._builder, self._builder.fsub(self.value, other.value, flags=_FUSED))

    def __mul__(self, other: Vector) -> Vector:
        return Vector(self._builder, self._builder.fmul(self.value, other.value, flags=_FUSED))


def plus(total: Vector, pairs: Iterable[tuple[Vector, Vector]]) -> Vector:
    """Add the products of pairs, of which there may be none."""
    for a, b in pairs:
        total = total + a * b
    return total


def products(pairs: Iterable[tuple[Vector, Vector]]) -> Vector:
    """Sum the products of pairs, in their order; there is at least one."""
    first, *rest = pairs
    return plus(first[0] * first[1], rest)


class Table:
    """An array of doubles whose last axis are the lanes.

    The sizes of an array are not known while code is emitted; so they are given where it is used.
    """

    def __init__(self, builder: Any, pointer: Any, shape: tuple[int, ...]) -> None:
        self._builder, self._pointer, self._shape = builder, pointer, shape

    def shaped(self, *shape: int) -> Self:
        """Return the same array with its sizes, those of the lanes left out."""
        return type(self)(self._builder, self._pointer, shape)

    def _place(self, index: tuple[int, ...] | int) -> Any:
        at = 0
        for one, size in zip(
            index if isinstance(index, tuple) else (index,), self._shape, strict=True
        ):
            assert 0 <= one < size
            at = at * size + one
        return self._builder.gep(self._pointer, [ir.Constant(_INDEX, at)])

    def _load(self, index: tuple[int, ...] | int) -> Any:
        value = self._builder.load(self._place(index))
        value.align = 8  # bytes: an array of doubles begins anywhere
        return value

    def __getitem__(self, index: tuple[int, ...] | int) -> Vector:
        return Vector(self._builder, self._load(index))

    def __setitem__(self, index: tuple[int, ...] | int, value: Vector) -> None:
        self._builder.store(value.value, self._place(index)).align = 8


class Shared(Table):
    """An array of doubles that all lanes share."""

    def __getitem__(self, index: tuple[int, ...] | int) -> Vector:
        nothing = ir.Constant(_DOUBLES, ir.Undefined)
        first = ir.Constant(ir.IntType(32), 0)
        one = self._builder.insert_element(nothing, self._load(index), first)
        everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return Vector(self._builder, self._builder.shuffle_vector(one, nothing, everywhere))


class Choice:
    """An integer that is known only when the code runs, such as the output that was read."""

    def __init__(self, builder: Any, value: Any) -> None:
        self._builder, self._value = builder, value

    def among(self, count: int) -> Iterator[int]:
        """Emit what follows once for each value from zero; the one that it has is executed."""
        for one in range(count):
            same = self._builder.icmp_signed("==", self._value, ir.Constant(self._value.type, one))
            with self._builder.if_then(same):
                yield one


class _Interpreted:
    """An array in place of a :class:`Table` where nothing is compiled, as debuggers want it."""

    def __init__(self, values: NDArray[np.float64], lanes: tuple[int, ...]) -> None:
        self._values, self._lanes = values, lanes

    def shaped(self, *shape: int) -> _Interpreted:
        return _Interpreted(self._values.reshape(*shape, *self._lanes), self._lanes)

    def __getitem__(self, index: tuple[int, ...] | int) -> NDArray[np.float64]:
        return np.array(self._values[index])

    def __setitem__(self, index: tuple[int, ...] | int, value: NDArray[np.float64]) -> None:
        self._values[index] = value


class _InterpretedChoice:
    def __init__(self, value: int) -> None:
        self._value = value

    def among(self, count: int) -> Iterator[int]:
        return (one for one in range(count) if one == self._value)


def _interpreted(kind: Any, value: Any) -> Any:
    if kind is int:
        return value
    if kind is Choice:
        return _InterpretedChoice(value)
    return _Interpreted(value, (LANES,) if kind is Table else ())


def emitted(emit: Callable[..., None]) -> Any:
    """Make a step that compiled code can call out of a function that emits it.

    The annotations of its arguments say what they are: an ``int`` has to be a constant of the
    caller (of Python, not of NumPy, and no sum of them), a :class:`Choice` is an integer, a
    :class:`Table` an array of doubles whose last axis are `LANES`, and :class:`Shared` one without
    that axis.
    """
    about = inspect.signature(emit, eval_str=True)
    kinds = [one.annotation for one in about.parameters.values()]
    if config.DISABLE_JIT:
        return lambda *given: emit(*map(_interpreted, kinds, given))

    def typed(context: Any, *arguments: Any) -> Any:
        def generate(target: Any, builder: Any, signature: Any, values: Any) -> Any:
            given: list[Any] = []
            for kind, numba_type, value in zip(kinds, signature.args, values, strict=True):
                if kind is int:
                    given.append(int(numba_type.literal_value))
                elif kind is Choice:
                    given.append(Choice(builder, value))
                else:
                    pointer = target.make_array(numba_type)(target, builder, value).data
                    if kind is Table:
                        pointer = builder.bitcast(pointer, _DOUBLES.as_pointer())
                    given.append(kind(builder, pointer, ()))
            emit(*given)
            return target.get_dummy_value()

        return types.void(*arguments), generate

    # numba asks for a function with these very arguments, and one for its own context
    first = inspect.Parameter("context", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    plain = [one.replace(annotation=one.empty) for one in about.parameters.values()]
    typed.__signature__ = inspect.Signature([first, *plain])  # type: ignore[attr-defined]
    typed.__name__ = emit.__name__
    return intrinsic(prefer_literal=True)(typed)
