"""The size at which a fault has a wanted strength."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .blueprint import Blueprint, Outcome
from .declared import Declared
from .kinds import UnreachableError, Vector, Whole
from .scene import Scene
from .sensors import Motion, Sensing
from .simulate import History

__all__ = ["Built", "Sized", "build", "sized"]

GRID = 7


@dataclass(frozen=True)
class Built:
    """A scene with faults of known sizes: histories, motion and vehicle file, and its strength."""

    histories: tuple[History, ...]
    motions: tuple[Motion, ...]
    sensing: tuple[Sensing, ...]
    declared: Declared
    strength: float


@dataclass(frozen=True)
class Sized:
    """A fault whose size has been found, with its strength alone."""

    blueprint: Blueprint
    size: float
    built: Built

    @property
    def outcome(self) -> Outcome:
        """What the spans of right values are computed from."""
        return Outcome(self.size, self.built.histories)


def _moved(
    scene: Scene, parts: Sequence[tuple[Blueprint, Vector]], runs: Whole
) -> tuple[History, list[Motion]]:
    """History and motion of columns with faults of given sizes (one of each for each column)."""
    made = [b.mechanism(sizes, runs) for b, sizes in parts if b.mechanism is not None]
    movers = [(b, sizes) for b, sizes in parts if b.mechanism is not None]
    if not made:
        picked = scene.motions(scene.history)
        return scene.history, [picked[run] for run in runs]
    history = scene.integrated(runs, made)
    extra = None
    for place, (blueprint, sizes) in zip(history.memory, movers, strict=True):
        if blueprint.mounts is not None:
            own = History(
                history.times,
                history.state[:, place],
                history.flow[:, place],
                history.delta,
                history.rate,
                history.suspension,
                history.runs,
                (),
            )
            more = blueprint.mounts(own, sizes)
            extra = more if extra is None else extra + more
    return history, scene.motions(history, extra)


def _columns(history: History, scene: Scene, runs: Sequence[int]) -> tuple[History, ...]:
    if history is scene.history:
        return tuple(history.column(int(run)) for run in runs)
    return tuple(history.column(number) for number in range(len(runs)))


def _strength(
    scene: Scene, motions: Sequence[Motion], sensing: Sequence[Sensing], declared: Declared
) -> float:
    rows = [scene.pure(motions[run], run, sensing) for run in range(2)]
    strength = scene.yardstick.strength(rows, declared)
    return strength if np.isfinite(strength) else 1e12


def build(scene: Scene, parts: Sequence[tuple[Blueprint, float]]) -> Built:
    """Drive the three runs with faults of given sizes."""
    runs = np.arange(3)
    columns = [(b, np.full(3, size)) for b, size in parts]
    history, motions = _moved(scene, columns, runs)
    sensing = tuple(b.sensing(size) for b, size in parts if b.sensing is not None)
    declared = scene.declared
    for blueprint, size in parts:
        if blueprint.declare is not None:
            declared = blueprint.declare(size)
    strength = _strength(scene, motions, sensing, declared)
    return Built(_columns(history, scene, range(3)), tuple(motions), sensing, declared, strength)


def _strengths(scene: Scene, blueprint: Blueprint, sizes: Vector) -> Vector:
    """Strengths of a fault at several sizes."""
    runs = np.tile(np.arange(2), len(sizes))
    with np.errstate(over="ignore", invalid="ignore"):
        _, motions = _moved(scene, [(blueprint, np.repeat(sizes, 2))], runs)
        found = []
        for number, size in enumerate(sizes):
            sensing = [] if blueprint.sensing is None else [blueprint.sensing(float(size))]
            declared = scene.declared
            if blueprint.declare is not None:
                declared = blueprint.declare(float(size))
            pair = motions[2 * number : 2 * number + 2]
            whole = all(bool(np.all(np.isfinite(m.acceleration["front_wheel"]))) for m in pair)
            found.append(_strength(scene, pair, sensing, declared) if whole else 1e12)
    return np.array(found)


def _crossing(sizes: Vector, strengths: Vector, target: float) -> float:
    """Size at the target by interpolation of logarithms."""
    order = np.argsort(sizes)
    x, y = np.log(sizes[order]), np.log(np.maximum(strengths[order], 1e-3))
    above = int(np.argmax(y >= np.log(target)))
    if above == 0:
        return float(sizes[order][0])
    low, high = above - 1, above
    share = (np.log(target) - y[low]) / (y[high] - y[low])
    return float(np.exp(x[low] + share * (x[high] - x[low])))


def sized(
    scene: Scene, blueprint: Blueprint, wanted: tuple[float, float], rng: np.random.Generator
) -> Sized:
    """Find the size whose strength is drawn log-uniformly from a range.

    The range is cut to what the fault can reach in this scene; if less than a factor of 1.5 is
    left, it is unreachable.
    """
    sizes = np.geomspace(*blueprint.span, GRID)
    strengths = _strengths(scene, blueprint, sizes)
    low = max(wanted[0], float(strengths[0]) * 1.02)
    high = min(wanted[1], float(np.max(strengths)) * 0.98)
    if high < 1.5 * low:
        raise UnreachableError
    target = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    for spread in (0.12, 0.03, 0.01):
        guess = _crossing(sizes, strengths, target)
        tried = np.array([guess / (1.0 + spread), guess * (1.0 + spread)])
        tried = np.clip(tried, *blueprint.span)
        sizes = np.concatenate([sizes, tried])
        strengths = np.concatenate([strengths, _strengths(scene, blueprint, tried)])
        error = np.abs(np.log(np.maximum(strengths, 1e-3) / target))
        if float(np.min(error)) < 0.06:
            break
    best = _crossing(sizes, strengths, target)
    built = build(scene, [(blueprint, best)])
    if not wanted[0] * 0.9 <= built.strength <= wanted[1] * 1.1:
        raise UnreachableError
    return Sized(blueprint, best, built)
