"""Memory layout of the lanes, in blocks of eight side by side, and their innermost loops.

A lane holds one car with one state.  A block is a table with a row for each quantity and one column
for each of its eight lanes, so that a compiler can load a row into one vector register.

A compiler keeps eight lanes in a vector register only where every statement of the loop over them
stands there by itself: with loops over elements and states inside it takes five times as long.  So
three functions are written as text for the sizes of a car, one statement an element and state.
They stand in place of the stubs of this module wherever compiled code calls these
(:func:`numba.extending.overload`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload
from numpy.typing import NDArray

from bayes_asv.filters.prediction import IN_PLACE, OPTIONS
from bayes_asv.filters.ukf_state import Sizes, sizes
from bayes_asv.filters.vector_code import LANES

__all__ = [
    "LANES",
    "WIDTH",
    "ZERO",
    "Rows",
    "Shape",
    "accelerations",
    "blocks",
    "horner",
    "lane_offset",
    "lane_rows",
    "matrices",
    "shape_of",
    "transition_lanes",
]

ZERO, WIDTH = np.uint64(0), np.uint64(LANES)


class Rows(NamedTuple):
    """Offsets of the rows in a block; each is that of the first row of its quantity.

    Fixed offsets into one array show the compiler that rows do not overlap, and unsigned ones that
    no index counts from the end.  Without either it would not vectorise, at eight times the cost.

    Parameters
    ----------
    A : int
        Accelerations (nR, 2 ne) by deflections and their rates.
    before, after : int
        States of the motion (nx,) before and after the step.
    slope : int
        Accelerations (nR,) at one state.
    forcing : int
        Filtered noise and bias (ne,) of the inputs, m/s².
    inverse_gain : int
        Inverse gains (ne,) of the input sensors.
    step : int
        Length of the step, s.
    reading : int
        Outputs (ny,).
    rate : int
        Bound of the eigenvalues, 1/s.
    damping, spring : int
        Rates (ne,) of the elements.
    input_gain, gain : int
        Gains (ne,) of the input sensors and (ny,) of the output sensors.
    geometry : int
        Polynomials (nG,) of :class:`bayes_asv.filters.ukf_state.Model`.
    parameters : int
        Parameters that are none of these.
    size : int
        Length of a block.
    """

    A: int
    before: int
    after: int
    slope: int
    forcing: int
    inverse_gain: int
    step: int
    reading: int
    rate: int
    damping: int
    spring: int
    input_gain: int
    gain: int
    geometry: int
    parameters: int
    size: int


def lane_rows(sizes: Sizes) -> Rows:
    """Return the offsets of the rows in a block."""
    ne, nx, ny, nR = sizes.elements, sizes.motion, sizes.outputs, sizes.rows
    n = sizes.coordinates
    places = [0]
    for count in (
        2 * ne * nR, nx, nx, nR, ne, ne, 1, ny, 1, ne, ne, ne, ny, ne * n + n + (nR - ne) * n,
        sizes.parameters,
    ):  # fmt: skip
        places.append(places[-1] + count * LANES)
    return Rows(*places)


@njit(**IN_PLACE)
def transition_lanes(ne: int) -> int:
    """Return the number of lanes after the sigma points, for the transition matrices."""
    return 4 * ne


@njit(**IN_PLACE)
def blocks(p: int, ne: int) -> int:
    """Return the number of blocks for p directions."""
    count: int = (1 + 2 * p + transition_lanes(ne) + LANES - 1) // LANES
    return count


@njit(**IN_PLACE)
def lane_offset(lane: int, size: int) -> np.uint64:
    """Return the offset of a lane in the first row of its block."""
    return np.uint64(lane >> 3) * np.uint64(size) + np.uint64(lane & 7)


Array = NDArray[np.float64]


# Text has no file beside which it could be kept: what calls it keeps it.
_OPTIONS = {name: value for name, value in OPTIONS.items() if name != "cache"}


class Shape(NamedTuple):
    """Sizes of a car as lengths of tuples, which are part of their type.

    Parameters
    ----------
    elements, rates, coordinates, rows, outputs : tuple
        Of as many zeros.
    bars : tuple
        Empty for a car without anti-roll bars.
    forces : tuple
        Empty without force laws.
    """

    elements: tuple[int, ...]
    rates: tuple[int, ...]
    coordinates: tuple[int, ...]
    rows: tuple[int, ...]
    outputs: tuple[int, ...]
    bars: tuple[int, ...]
    forces: tuple[int, ...]


def shape_of(of: Sizes) -> Shape:
    """Return the shape that belongs to sizes."""
    counts = (of.elements, of.rates, of.coordinates, of.rows, of.outputs, of.bars, of.forces)
    return Shape(*((0,) * count for count in counts))


def horner(shape: Shape, W: Array, at: np.uint64, inputs: Array, order: int) -> None:
    """Propagate one block over its step."""
    raise NotImplementedError


def matrices(shape: Shape, W: Array, at: np.uint64, bars: Array) -> None:
    """Fill the accelerations by states of one block, and the bound of its eigenvalues."""
    raise NotImplementedError


def accelerations(shape: Shape, W: Array, at: np.uint64) -> None:
    """Fill the accelerations at the states before the step of one block."""
    raise NotImplementedError


@overload(horner, strict=False, jit_options=_OPTIONS)
def _horner(shape: Any, W: Any, at: Any, inputs: Any, order: Any) -> Callable[..., None]:
    return _function("horner", ("shape", "W", "at", "inputs", "order"), _horner_lines, shape)


@overload(matrices, strict=False, jit_options=_OPTIONS)
def _matrices(shape: Any, W: Any, at: Any, bars: Any) -> Callable[..., None]:
    return _function("matrices", ("shape", "W", "at", "bars"), _matrices_lines, shape)


@overload(accelerations, strict=False, jit_options=_OPTIONS)
def _accelerations(shape: Any, W: Any, at: Any) -> Callable[..., None]:
    return _function("accelerations", ("shape", "W", "at"), _accelerations_lines, shape)


def _function(
    name: str,
    arguments: tuple[str, ...],
    lines: Callable[[Sizes, Rows], list[str]],
    shape: types.BaseTuple,
) -> Callable[..., None]:
    """Compile the text of a function for a shape; ``{n}`` in it is a row at offset n."""
    counts = [len(part) for part in shape.types]
    of = sizes(
        elements=counts[0], rates=counts[1], coordinates=counts[2], rows=counts[3],
        outputs=counts[4], bars=counts[5], forces=counts[6], directions=0, parameters=0, answers=0,
    )  # fmt: skip
    text = lines(of, lane_rows(of))
    scope: dict[str, Any] = {"ZERO": ZERO, "WIDTH": WIDTH, "np": np}
    head = f"def {name}({', '.join(arguments)}):\n"
    exec(head + "".join(f"    {line}\n" for line in text), scope)
    function: Callable[..., None] = scope[name]
    return function


def _row(first: int, number: int = 0) -> str:
    """Element of a row of the lane at m."""
    return f"W[m + np.uint64({first + number * LANES})]"


def _horner_lines(of: Sizes, rows: Rows) -> list[str]:
    ne, nr = of.elements, of.rates
    elements, states = range(ne), range(2 * ne)
    after, before = rows.after, rows.before
    out = [f"u{e} = inputs[{e}, order]" for e in elements]
    out += ["for q in range(ZERO, WIDTH):", "    m = at + q"]
    out += [f"    h = {_row(rows.step)} / (order + 1)"]
    for e in elements:
        out += [
            f"    {_row(after, 2 * e)} = {_row(before, 2 * e)}",
            f"    {_row(after, 2 * e + 1)} = {_row(before, 2 * e + 1)}"
            f" + {_row(rows.inverse_gain, e)} * u{e} + {_row(rows.forcing, e)} * h",
        ]
    out += [f"    {_row(after, 2 * ne + r)} = {_row(before, 2 * ne + r)}" for r in range(nr)]
    out += ["for j in range(order - 1, -1, -1):", "    share = 1.0 / (j + 1)"]
    out += [f"    u{e} = inputs[{e}, j]" for e in elements]
    out += ["    for q in range(ZERO, WIDTH):", "        m = at + q"]
    out += [f"        h = {_row(rows.step)} * share"]
    out += [f"        v{c} = {_row(after, c)}" for c in states]
    for r in range(ne + nr):
        terms = [_row(rows.forcing, r)] if r < ne else []
        terms += [f"{_row(rows.A, 2 * ne * r + c)} * v{c}" for c in states]
        out += [f"        s{r} = {' + '.join(terms)}"]
    for e in elements:
        out += [
            f"        {_row(after, 2 * e)} = {_row(before, 2 * e)} + h * v{2 * e + 1}",
            f"        {_row(after, 2 * e + 1)} = {_row(before, 2 * e + 1)}"
            f" + {_row(rows.inverse_gain, e)} * u{e} + h * s{e}",
        ]
    out += [
        f"        {_row(after, 2 * ne + r)} = {_row(before, 2 * ne + r)} + h * s{ne + r}"
        for r in range(nr)
    ]
    return out


def _matrices_lines(of: Sizes, rows: Rows) -> list[str]:
    ne, n, nR = of.elements, of.coordinates, of.rows
    elements = range(ne)
    out = [f"b{e}{f} = bars[{e}, {f}]" for e in elements for f in elements if of.bars]
    out += ["for q in range(ZERO, WIDTH):", "    m = at + q"]
    out += [f"    j{j} = 1.0 / {_row(rows.geometry, ne * n + j)}" for j in range(n)]
    for r in range(nR):
        first = r * n if r < ne else ne * n + n + (r - ne) * n
        out += [f"    p{j} = {_row(rows.geometry, first + j)} * j{j}" for j in range(n)]
        for f in elements:  # acceleration by a force at element f
            products = [f"p{j} * {_row(rows.geometry, f * n + j)}" for j in range(n)]
            out += [f"    a{f} = {' + '.join(products)}"]
        for f in elements:
            stiff = f"a{f} * {_row(rows.spring, f)}"
            if of.bars:
                stiff += "".join(f" + a{g} * b{g}{f}" for g in elements)
            out += [
                f"    {_row(rows.A, 2 * ne * r + 2 * f)} = -({stiff})",
                f"    {_row(rows.A, 2 * ne * r + 2 * f + 1)} = -(a{f} * {_row(rows.damping, f)})",
            ]
    out += ["for q in range(ZERO, WIDTH):", "    m = at + q"]
    for what, offset in (("c", 1), ("k", 0)):
        for r in elements:
            sizes_ = [f"abs({_row(rows.A, 2 * ne * r + 2 * f + offset)})" for f in elements]
            out += [f"    {what}{r} = {' + '.join(sizes_)}"]
        largest = f"{what}0"
        for r in range(1, ne):
            largest = f"max({largest}, {what}{r})"
        out += [f"    {what} = {largest}"]
    return [*out, f"    {_row(rows.rate)} = c + np.sqrt(k)"]


def _accelerations_lines(of: Sizes, rows: Rows) -> list[str]:
    states = range(2 * of.elements)
    out = ["for q in range(ZERO, WIDTH):", "    m = at + q"]
    out += [f"    x{c} = {_row(rows.before, c)}" for c in states]
    forces, first = range(of.forces), of.motion - of.forces
    out += [f"    f{f} = -{_row(rows.before, first + f)} / {_row(rows.damping, f)}" for f in forces]
    for r in range(of.rows):
        terms = [f"{_row(rows.A, 2 * of.elements * r + c)} * x{c}" for c in states]
        # by a force: by the rate of deflection over minus the damping rate
        terms += [f"{_row(rows.A, 2 * of.elements * r + 2 * f + 1)} * f{f}" for f in forces]
        out += [f"    {_row(rows.slope, r)} = {' + '.join(terms)}"]
    return out
