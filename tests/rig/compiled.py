"""The only place of the rig that knows numba.

numba ships no type information, so its decorators are wrapped here in functions that have it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, TypeVar, cast

__all__ = ["call_native", "compiled", "native_address"]

_F = TypeVar("_F", bound=Callable[..., Any])

_numba: Any = importlib.import_module("numba")
_extending: Any = importlib.import_module("numba.extending")
_ir: Any = importlib.import_module("llvmlite.ir")


def compiled(function: _F) -> _F:
    """Compile on first use, keep the result on disk, release the interpreter lock."""
    return cast("_F", _numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def native_address(function: Callable[[float, float, float], float]) -> tuple[Any, int]:
    """Compile ``double f(double, double, double)``; return what keeps it alive, and its address."""
    callback = _numba.cfunc("float64(float64, float64, float64)")(function)
    return callback, int(callback.address)


def _call_native(typing_context: Any, address: Any, a: Any, b: Any, c: Any) -> Any:
    """Emit a call through a function pointer.

    numba's own first-class functions would do, but warn that they are experimental, and a
    kernel specialised on a function would be compiled anew for every law.
    """
    real = _numba.types.float64
    signature = real(_numba.types.intp, real, real, real)

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        double = _ir.DoubleType()
        shape = _ir.FunctionType(double, [double, double, double])
        pointer = builder.inttoptr(arguments[0], shape.as_pointer())
        return builder.call(pointer, arguments[1:])

    return signature, emit


call_native: Callable[[int, float, float, float], float] = _extending.intrinsic(_call_native)
