"""What the readable filter thinks of its noise and of itself, as ``kernels.doubts`` has it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.ukf import DONE, LEARNED, LOOK, UPSET
from bayes_asv.filters.ukf_state import (
    BROKEN,
    CLOCK,
    COLOUR,
    DOUBTED,
    LAGS,
    LOST,
    QUICK,
    SUM,
    WEIGHT,
    Rules,
)

__all__ = ["Doubts"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Doubts:
    """Level of the noise, colour of the innovations, and whether something has to be decided.

    Parameters
    ----------
    memory, echo : arrays
        Of the filter's state, changed in place.
    rules : Rules
        When to doubt.
    """

    memory: Array
    echo: Array
    rules: Rules

    def levels(self) -> Array:
        """Level of each axle's noise."""
        trust, memory = self.rules.trust, self.memory
        slow = (trust + memory[SUM : SUM + 2]) / (trust + memory[WEIGHT : WEIGHT + 2])
        quick = memory[QUICK : QUICK + 2]
        return np.where(quick > np.maximum(slow, self.rules.sudden), quick, slow)

    def learn_level(self, axle: int, ratio: float, level: float) -> None:
        """Hold a reading's squared deviations against what its noise would give."""
        rules, memory = self.rules, self.memory
        raw = min(ratio, rules.gate) * level
        memory[SUM + axle] += min(raw, rules.gate) - memory[SUM + axle] / rules.window
        memory[WEIGHT + axle] += 1.0 - memory[WEIGHT + axle] / rules.window
        memory[QUICK + axle] += (raw - memory[QUICK + axle]) / rules.quick

    def listen(self, axle: int, nu: float) -> None:
        """Hold a normalised innovation against those before it."""
        edge = math.sqrt(self.rules.gate)
        past, products = self.echo[axle]
        past[0] = min(max(nu, -edge), edge)
        products += (past[0] * past - products) / self.rules.window
        past[1:] = past[:-1].copy()

    def doubt(self) -> None:
        """Doubt constant parameters while the innovations say more than white ones would."""
        taper = 2.0 * (1.0 - np.arange(1, LAGS + 1) / (LAGS + 1.0))
        products = self.echo[:, 1]
        most = float(np.max(1.0 + (products[:, 1:] / products[:, :1]) @ taper))
        self.memory[COLOUR] = most
        if most > self.rules.coloured:
            self.memory[DOUBTED] = 1.0
        elif most**2 < self.rules.coloured:
            self.memory[DOUBTED] = 0.0

    def event(self) -> int:
        """Whether something has to be decided."""
        if self.memory[BROKEN] > self.rules.patience:
            return UPSET
        if self.memory[LOST] > self.rules.learned:
            return LEARNED
        return LOOK if self.memory[CLOCK] > self.rules.look else DONE
