"""A fault that has been chosen for a scene, and whose size is still open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from .declared import Declared
from .kinds import Span, Vector, Whole
from .sensors import Sensing
from .simulate import History, Mechanism

__all__ = ["Blueprint", "Outcome", "Spans", "hull", "point"]


@dataclass(frozen=True)
class Outcome:
    """A fault of a size that was found, and the histories of the runs with it (one column each)."""

    size: float
    histories: tuple[History, ...]


@dataclass(frozen=True)
class Spans:
    """Spans of right values: parameters of the fault, and damping rates where ambiguous."""

    parameters: dict[str, Span] = field(default_factory=dict)
    c_f: Span | None = None
    c_r: Span | None = None


def _nothing(outcome: Outcome) -> Spans:
    return Spans()


@dataclass(frozen=True)
class Blueprint:
    """A fault of open size.

    ``span`` has the least and the largest size. ``mechanism`` makes the part for columns of given
    sizes and runs; ``sensing`` and ``declare`` say what a size does to sensors and to the vehicle
    file; ``mounts`` gives what is added to the chassis accelerations (steps, 2, B);
    ``spans`` the values that may rightly be reported.
    """

    name: str
    where: str | None
    form: str
    span: Span
    mechanism: Callable[[Vector, Whole], Mechanism] | None = None
    sensing: Callable[[float], Sensing] | None = None
    declare: Callable[[float], Declared] | None = None
    mounts: Callable[[History, Vector], Vector] | None = None
    spans: Callable[[Outcome], Spans] = _nothing


def hull(*values: float) -> Span:
    """Least span that contains all values."""
    return float(min(values)), float(max(values))


def point(value: float) -> Span:
    """Span of one value."""
    return float(value), float(value)
