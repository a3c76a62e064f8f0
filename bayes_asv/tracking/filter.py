"""The filter with its second thoughts: what it does when a run of the engine comes back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import wander
from bayes_asv.filters.ukf import LEARNED, LOOK, UPSET, run
from bayes_asv.filters.ukf_state import (
    BROKEN,
    CLOCK,
    COLUMNS,
    LOST,
    Model,
    Rules,
    State,
    Steps,
)
from bayes_asv.tracking.prior_state import (
    RULES,
    beginning,
    copied,
    forget_everything_but,
    sound,
    volume,
)
from bayes_asv.tracking.relinearization import Stretch, cut, joined_steps, relinearised

__all__ = ["ENGINES", "Engine", "Filter"]

Array = NDArray[np.float64]

Engine = Callable[[int, bool, State, Model, Rules, Steps, Array], tuple[int, int]]

# A parameter is known well enough for a filter without second thoughts when its deviation is
# below this, and the last two looks back moved it by less than a tenth of it.  One that does
# not stay where it was is another matter, and looking back will not mend it.
_KNOWN = 0.05
_MOVED = 0.1
_LOOKS = 2
_MOST_LOOKS = 5
_LONGEST = 8.0  # s of record that are remembered
_NOTHING = 0.02  # of the volume's logarithm: so little was learnt that the stretch may go
_DOUBLED = 8.0  # s of patience at most


def _reference(
    first: int, fixed: bool, state: State, model: Model, rules: Rules, steps: Steps, out: Array
) -> tuple[int, int]:
    from bayes_asv.tracking.reference_ukf import run as readable

    return readable(first, fixed, state, model, rules, steps, out)


ENGINES: dict[str, Engine] = {"compiled": run, "filterpy": _reference}


@dataclass
class Filter:
    """States and parameters, row after row.

    Parameters
    ----------
    model : Model
        Car and sensors.
    engine : str
        One of :data:`ENGINES`.
    rules : Rules
        When to doubt.
    """

    model: Model
    engine: str = "compiled"
    rules: Rules = RULES
    state: State = field(init=False)
    looking_back: bool = field(init=False, default=True)
    resets: list[float] = field(init=False, default_factory=list)
    time: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.state = beginning(self.model)
        self._begin_stretch()
        self._patience = self.rules.patience
        self._calm = self._looks = 0

    def advance(self, steps: Steps) -> Array:
        """Take steps; return what was known after each (N, COLUMNS), see ``filter_state``."""
        out = np.zeros((len(steps.step), COLUMNS))
        at = 0
        while at < len(steps.step):
            began = at
            event, at = ENGINES[self.engine](
                at, False, self.state, self._model(), self._rules(), steps, out
            )
            taken = cut(steps, began, at)
            self.time += float(taken.step.sum())
            if not sound(self.state):
                self._begin_again()
                out[began:at] = 0.0
                out[began:at, :6] = _told(self.state)
                continue
            if self.looking_back:
                self._held.append(taken)
            if event == LEARNED:
                self._look_back()
                out[at - 1, :6] = _told(self.state)
            elif event == UPSET:
                self._upset()
            elif event == LOOK:
                self._look()
        return out

    def begin_another(self) -> None:
        """Begin another recording with the same car: motion and biases are new."""
        self.state = forget_everything_but(self.state, self.state.mu, self.state.D, self.model)
        if self.looking_back:
            self._begin_stretch()

    def _model(self) -> Model:
        """Parameters do not walk before they are known: looking back takes them for constant."""
        if not self.looking_back:
            return self.model
        still = np.zeros_like(self.model.walk)
        return self.model._replace(walk=still, doubt=still)

    def _rules(self) -> Rules:
        rules = self.rules._replace(patience=self._patience)
        return rules if self.looking_back else rules._replace(learned=math.inf, look=math.inf)

    def _begin_stretch(self) -> None:
        self.state.memory[LOST] = self.state.memory[CLOCK] = 0.0
        self._known = copied(self.state)
        self._held: list[Steps] = []

    def _begin_again(self) -> None:
        """Something overflowed: all that was learnt goes."""
        self.state = beginning(self.model)
        self.looking_back = True
        self._begin_stretch()
        self.resets.append(self.time)

    def _look_back(self) -> None:
        """Run the stretch again; stop remembering when that changes nothing any more."""
        stretch = Stretch(self._known, joined_steps(self._held))
        found, moved = relinearised(stretch, self.state, self.model, self.rules)
        self._held = [stretch.steps]
        self.state.memory[LOST] = 0.0
        self._calm = self._calm + 1 if moved < _MOVED else 0
        if sound(found):
            self.state = found
        widest = np.max(np.sqrt(np.sum(self.state.D[:, :3] ** 2, axis=0)) * self.model.scale[:3])
        self._looks = self._looks + 1 if widest < _KNOWN else 0
        if self._looks and (self._calm >= _LOOKS or self._looks >= _MOST_LOOKS):
            self.looking_back = False
            self._held = []
            if self.model.walk.any():  # what they may have done meanwhile
                seconds = float(stretch.steps.step.sum())
                wander(self.state.D, self.state.J, self.state.Pi, self.model.walk * seconds)

    def _look(self) -> None:
        """Nothing special: forget a stretch that taught nothing, or that is too long."""
        self.state.memory[CLOCK] = 0.0
        held = sum(float(part.step.sum()) for part in self._held)
        if volume(self._known) - volume(self.state) < _NOTHING:
            self._begin_stretch()
        elif held > _LONGEST:
            self._look_back()
            if self.looking_back:
                self._begin_stretch()

    def _upset(self) -> None:
        """More than noise is at fault: doubt motion and biases, and what was learnt since."""
        safe = self.state.safe[0]
        self.state = forget_everything_but(
            self.state, safe[:, 0], np.ascontiguousarray(safe[:, 1:]), self.model
        )
        self.state.memory[BROKEN] = 0.0
        recent = bool(self.resets) and self.time - self.resets[-1] < 4.0 * self._patience + 1.0
        self._patience = (
            min(2.0 * self._patience, _DOUBLED) if recent else self.rules.patience
        )  # fmt: skip
        self.resets.append(self.time)
        if self.looking_back:
            self._begin_stretch()


def _told(state: State) -> Array:
    """First six columns of what is told."""
    return np.concatenate([state.mu[:3], np.sqrt(np.sum(state.D[:, :3] ** 2, axis=0))])
