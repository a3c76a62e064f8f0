"""A document of a diagnosis judged against the truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.units import si_factor
from bayes_asv.models.effects import EFFECTS
from benchmarks.battery.run import Result
from tests.battery.truth import TrueEffect, Truth
from tests.battery.unlisted_faults import NAMES

__all__ = ["CONFIDENT", "PARAMETERS", "Gap", "Judged", "judge"]

CONFIDENT = 0.9
PARAMETERS = ("c_f", "c_r", "i")
_DIMENSION = {"c_f": "damping", "c_r": "damping", "i": "pitch_inertia"}
# Relative increase of the gap that counts, where a document has no bootstrap interval.
_CHANGED = 0.01

_ENGINE = "engine_vibration"  # which the diagnosis names as well, although it is no effect

Claim = tuple[str, str]


@dataclass(frozen=True)
class Gap:
    """The held-out simulation error.

    Parameters
    ----------
    before, after, floor : float
        Root-mean-squares, in the document's unit.
    worse : bool
        The error increased, by the document's own bootstrap interval if it has one.
    """

    before: float
    after: float
    floor: float
    worse: bool

    @property
    def closed(self) -> float:
        """Share of the squared error above the floor that was removed; nan if none is above."""
        above = self.before**2 - self.floor**2
        return 1.0 - (self.after**2 - self.floor**2) / above if above > 0.0 else math.nan


@dataclass(frozen=True)
class Judged:
    """A case with the judgement of its diagnosis.

    Parameters
    ----------
    truth : Truth
        Truth of the case.
    verdict : str
        ``agreement``, ``named``, ``unexplained``, ``refused`` or ``error``.
    named : tuple of str
        Names of the effects, in the order in which they were added.
    flagged : bool
        It reports something unexplained.
    name_right : bool
        The first effect has the name of a true one, at any place.
    first_right : bool
        The first effect is a true one, by name and place.
    class_right : bool
        It, or one that is indistinguishable from it, is a true one.
    found : tuple of bool
        For each true effect: it, or an indistinguishable one, is named.
    extra : int
        Named effects that are neither true nor indistinguishable from a true one.
    confidently_wrong : bool
        An effect that is not true (nor its class) has a probability of 0.9 or more, and nothing is
        reported as unexplained.
    probabilities : tuple of (float, bool)
        For each named effect: its probability, and whether it or its class is true.
    gap : Gap or None
        The held-out simulation error, if the document has it.
    covered_before, covered_after : dict of str to bool
        For c_f, c_r, i: the 95 % interval overlaps the true span.
    width_after : dict of str to float
        Its width over 2 x 1.96 times the true value.
    effects_covered : tuple of (str, str, bool)
        For each reported parameter of an effect that is true by name and place: effect, parameter,
        and whether the 95 % interval holds its true value.
    seconds : float
        Computing time.
    """

    truth: Truth
    verdict: str
    named: tuple[str, ...]
    flagged: bool
    name_right: bool
    first_right: bool
    class_right: bool
    found: tuple[bool, ...]
    extra: int
    confidently_wrong: bool
    probabilities: tuple[tuple[float, bool], ...]
    gap: Gap | None
    covered_before: dict[str, bool] = field(default_factory=dict)
    covered_after: dict[str, bool] = field(default_factory=dict)
    width_after: dict[str, float] = field(default_factory=dict)
    effects_covered: tuple[tuple[str, str, bool], ...] = ()
    seconds: float = 0.0

    @property
    def said(self) -> str:
        """Column of the confusion matrix: the first effect's name, or the verdict."""
        return self.named[0] if self.named else self.verdict


def judge(result: Result, truth: Truth) -> Judged:
    """Judge a result against the truth.

    Raises
    ------
    InputError
        If the document does not follow ``bayes_asv/diagnose/1``.
    """
    try:
        return _judge(result.document, truth, result.seconds)
    except (KeyError, TypeError, ValueError, AttributeError, InputError) as exc:
        raise InputError(
            f"{result.name} {result.number}",
            f"has a document that cannot be read ({type(exc).__name__}: {exc})",
            "compare it with bayes_asv/diagnose/1",
        ) from exc


def _judge(document: Mapping[str, Any], truth: Truth, seconds: float) -> Judged:
    verdict = str(document["verdict"])
    effects: Sequence[Mapping[str, Any]] = document.get("effects") or []
    flagged = verdict == "unexplained" or bool((document.get("unexplained") or {}).get("present"))
    told = [_claim(one) for one in effects]
    classes = [
        [
            (name, where)
            for claim, where in (_claim(one), *map(_claim, one.get("indistinguishable_from") or []))
            # a free curve is of the class of the laws that it contains
            for name in (claim, *(EFFECTS[claim].contains if claim in EFFECTS else ()))
        ]
        for one in effects
    ]
    called = [replace(one, name=NAMES.get(one.name, one.name)) for one in truth.effects]
    listed = tuple(one for one in called if one.name in EFFECTS or one.name == _ENGINE)
    right = [any(_says(mine, one, classes) for one in listed) for mine in classes]
    probabilities = tuple(
        (float(one["probability"]), yes) for one, yes in zip(effects, right, strict=True)
    )
    everything = [claim for mine in classes for claim in mine]
    return Judged(
        truth=truth,
        verdict=verdict,
        named=tuple(name for name, _ in told),
        flagged=flagged,
        name_right=bool(told) and told[0][0] in {one.name for one in listed},
        first_right=bool(told)
        and any(_says(told[:1], one, [[claim] for claim in told]) for one in listed),
        class_right=bool(right) and right[0],
        found=tuple(_covers(everything, one) for one in listed),
        extra=sum(not yes for yes in right),
        confidently_wrong=not flagged
        and any(p >= CONFIDENT and not yes for p, yes in probabilities),
        probabilities=probabilities,
        gap=_gap(document),
        covered_before=_covered(document.get("parameters_before"), truth),
        covered_after=_covered(document.get("parameters_after"), truth),
        width_after=_widths(document.get("parameters_after"), truth),
        effects_covered=_effects_covered(effects, truth),
        seconds=seconds,
    )


def _claim(effect: Mapping[str, Any]) -> Claim:
    return str(effect["name"]), str(effect.get("where") or "")


def _covers(claims: Iterable[Claim], one: TrueEffect) -> bool:
    """Whether claims name an effect: at its place, or one at each axle for both.

    An engine acts on the whole car: its tone needs no place.
    """
    there = set(claims)
    if (one.name, one.where) in there:
        return True
    if one.name == _ENGINE and (one.name, "") in there:
        return True
    return one.where == "both" and {(one.name, "front"), (one.name, "rear")} <= there


def _says(mine: Sequence[Claim], one: TrueEffect, every: Sequence[Sequence[Claim]]) -> bool:
    """Whether one entry names an effect, alone or as one of two entries for the axles."""
    if _covers(mine, one):
        return True
    if one.where != "both" or not any(name == one.name for name, _ in mine):
        return False
    return _covers([claim for others in every for claim in others], one)


def _gap(document: Mapping[str, Any]) -> Gap | None:
    held = (document.get("gap") or {}).get("holdout")
    if not held or any(held.get(key) is None for key in ("before", "floor")):
        return None
    before, floor = float(held["before"]), float(held["floor"])
    after = before if held.get("after") is None else float(held["after"])
    grown = held.get("worse")
    if grown is None:
        grown = after > before * (1.0 + _CHANGED)
    return Gap(before, after, floor, worse=bool(grown))


def _interval(parameters: Mapping[str, Any], name: str) -> tuple[float, float] | None:
    """95 % interval of a parameter, SI; None if the document has none."""
    one = parameters.get(name)
    if not one or one.get("eti95") is None:
        return None
    factor = si_factor(str(one["unit"]), _DIMENSION[name])
    low, high = (float(end) * factor for end in one["eti95"])
    return low, high


def _covered(parameters: Mapping[str, Any] | None, truth: Truth) -> dict[str, bool]:
    out = {}
    for name in PARAMETERS:
        ends = _interval(parameters or {}, name)
        if ends is not None:
            low, high = truth.meant[name]
            out[name] = ends[0] <= high and ends[1] >= low
    return out


def _effects_covered(
    effects: Sequence[Mapping[str, Any]], truth: Truth
) -> tuple[tuple[str, str, bool], ...]:
    out = []
    for one in effects:
        true = next((e for e in truth.effects if (e.name, e.where) == _claim(one)), None)
        for name, value in (one.get("parameters") or {}).items():
            span = None if true is None else true.span(name)
            if span is None or value.get("eti95") is None:
                continue
            factor = _to_si(str(value["unit"]))
            low, high = (float(end) * factor for end in value["eti95"])
            out.append((str(one["name"]), name, low <= span[1] and high >= span[0]))
    return tuple(out)


def _to_si(unit: str) -> float:
    """Return the factor to SI of the unit of an effect's parameter."""
    if unit.startswith("1/") and unit.endswith("^2"):
        return si_factor(unit[2:-2], "length") ** -2
    if unit.endswith("^2/s"):  # a drift
        return si_factor(unit[:-2], "acceleration")
    for dimension in ("force", "stiffness", "length", "velocity", "time", "frequency"):
        with suppress(InputError):
            return si_factor(unit, dimension)
    return 1.0


def _widths(parameters: Mapping[str, Any] | None, truth: Truth) -> dict[str, float]:
    out = {}
    for name in PARAMETERS:
        ends = _interval(parameters or {}, name)
        if ends is not None:
            out[name] = (ends[1] - ends[0]) / (2.0 * 1.959964 * truth.car[name])
    return out
