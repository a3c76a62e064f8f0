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
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

__all__ = [
    "LANES", "Choice", "Shared", "Table", "Vector", "emitted", "expm1", "lanes_last", "plus",
    "power", "products", "sqrt", "where_positive",
]  # fmt: skip

LANES = 8
"""Parameter sets in a vector, as many as AVX-512 has; a narrower machine takes several turns."""

_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(64)
_FUSED = ("contract",)


def lanes_last(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Divide parameter sets (W, …) into blocks (K, …, LANES); the last set fills them up."""
    W = len(values)
    blocks = -(-W // LANES)
    filled = values[np.minimum(np.arange(blocks * LANES), W - 1)]
    split = filled.reshape(blocks, LANES, *values.shape[1:])
    return np.ascontiguousarray(split.transpose(0, *range(2, split.ndim), 1))


class Vector:
    """A number for each lane, in a register of the code that is emitted."""

    def __init__(self, builder: Any, value: Any) -> None:
        self._builder, self.value = builder, value

    def _with(self, name: str, other: Vector | float, turned: bool = False) -> Vector:
        """Emit an instruction with another vector, or with a number that all lanes share."""
        value = other.value if isinstance(other, Vector) else _everywhere(other)
        pair = (value, self.value) if turned else (self.value, value)
        return Vector(self._builder, getattr(self._builder, name)(*pair, flags=_FUSED))

    def __add__(self, other: Vector | float) -> Vector:
        return self._with("fadd", other)

    def __radd__(self, other: float) -> Vector:
        return self._with("fadd", other, turned=True)

    def __sub__(self, other: Vector | float) -> Vector:
        return self._with("fsub", other)

    def __rsub__(self, other: float) -> Vector:
        return self._with("fsub", other, turned=True)

    def __mul__(self, other: Vector | float) -> Vector:
        return self._with("fmul", other)

    def __rmul__(self, other: float) -> Vector:
        return self._with("fmul", other, turned=True)

    def __truediv__(self, other: Vector | float) -> Vector:
        return self._with("fdiv", other)

    def __rtruediv__(self, other: float) -> Vector:
        return self._with("fdiv", other, turned=True)

    def __neg__(self) -> Vector:
        return self._with("fsub", -0.0, turned=True)

    def __abs__(self) -> Vector:
        return self.function("fabs")

    def function(self, name: str, *others: Vector) -> Vector:
        """Emit a function of the compiler's own; those without an instruction go lane by lane."""
        given = [x.value for x in (self, *others)]
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES] * len(given))
        called = cgutils.get_or_insert_function(
            self._builder.module, kind, f"llvm.{name}.v{LANES}f64"
        )
        return Vector(self._builder, self._builder.call(called, given))

    def library_function(self, name: str) -> Vector:
        """Call a function of the C library lane by lane."""
        kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()])
        called = cgutils.get_or_insert_function(self._builder.module, kind, name)
        out = self.value
        for lane in range(LANES):
            at = ir.Constant(ir.IntType(32), lane)
            one = self._builder.call(called, [self._builder.extract_element(self.value, at)])
            out = self._builder.insert_element(out, one, at)
        return Vector(self._builder, out)

    def where_positive(self, positive: Vector | float, otherwise: Vector | float) -> Vector:
        """Pick one number or the other in each lane."""
        above = self._builder.fcmp_ordered(">", self.value, _everywhere(0.0))
        pair = (x.value if isinstance(x, Vector) else _everywhere(x) for x in (positive, otherwise))
        return Vector(self._builder, self._builder.select(above, *pair))


def _everywhere(number: float) -> Any:
    return ir.Constant(_DOUBLES, [float(number)] * LANES)


# Where nothing is compiled, arrays stand in for vectors.


def where_positive(x: Any, positive: Any, otherwise: Any) -> Any:
    """Pick ``positive`` in the lanes where x > 0, and ``otherwise`` in the others."""
    if isinstance(x, Vector):
        return x.where_positive(positive, otherwise)
    return np.where(x > 0.0, positive, otherwise)


def sqrt(x: Any) -> Any:
    """Return the square root."""
    return x.function("sqrt") if isinstance(x, Vector) else np.sqrt(x)


def power(x: Any, exponent: Any) -> Any:
    """Return x to a power; x is positive."""
    return x.function("pow", exponent) if isinstance(x, Vector) else x**exponent


def expm1(x: Any) -> Any:
    """Return exp(x) − 1."""
    return x.library_function("expm1") if isinstance(x, Vector) else np.expm1(x)


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

    def among(self, values: Iterable[int]) -> Iterator[int]:
        """Emit what follows once for each of its values; the one that it has is executed."""
        for one in values:
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

    def among(self, values: Iterable[int]) -> Iterator[int]:
        return (one for one in values if one == self._value)


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
