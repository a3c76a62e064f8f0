"""The state-space model that every car has in common.

A car is a rigid body on suspension elements, each above a wheel hub whose acceleration is measured.
With q the body's coordinates (heave, pitch, …), H the heights of the element tops per unit of q,
J the diagonal matrix of masses and inertias, and deflections δ = H q − wheel (extension positive)::

    F = −K δ − c δ̇ + f              forces up on the body; f beyond linear springs and dampers
    q̈ = J⁻¹ Hᵀ F                    δ̈ = H q̈ − ü

Absolute heights never enter, and nothing is integrated twice.  An output is an acceleration p·q̈ of
a point of the body, a deflection, or a rate of a coordinate; the last has a state of its own, whose
derivative is that coordinate's acceleration.  The states are (δ₁, δ̇₁, δ₂, δ̇₂, …, rates).

All readings are taken behind one common first-order filter with pole λ.  An output without a filter
of its own reads x = x_λ + ẋ_λ/λ of a filtered quantity x_λ, which is exact.

A car is one value of :class:`CarModel`; to add one, see ``docs/extending.md``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Given, Nominal
from bayes_asv.filters.kalman import StateSpace
from bayes_asv.models.outputs import OUTPUTS, Motion

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Axle, Channel, Side
    from bayes_asv.domain.vehicle import Given, Nominal

__all__ = [
    "DAMPING_FACTOR",
    "INERTIA_FACTOR",
    "MAX_PRIOR_DISTANCE",
    "NOISE_GIVEN_SD",
    "NOISE_UNKNOWN_SD",
    "CarModel",
    "CarParameter",
    "Element",
    "Output",
    "Values",
    "bias_directions",
    "constant",
    "estimated",
    "fastest_rate",
    "given",
    "initial_covariance",
    "log_normal_sd",
    "prior_log_sd",
    "state_space",
]

DAMPING_FACTOR = 3.0
"""A damping rate may be off by this factor at one deviation."""
INERTIA_FACTOR = 2.0
"""The same of a moment of inertia."""
NOISE_GIVEN_SD = 0.3
"""Deviation of a noise level's logarithm: a data sheet's figure is good to about a third."""
NOISE_UNKNOWN_SD = math.log(3.0)
"""The same without one: the quiet part of the record gives the level to a factor of three."""
MAX_PRIOR_DISTANCE = 30.0
"""Prior deviations beyond which nothing is tried."""


def log_normal_sd(value: float, sd: float) -> float:
    """Deviation of the logarithm of a log-normal with this median and this deviation."""
    return math.sqrt(math.log(0.5 * (1.0 + math.sqrt(1.0 + 4.0 * (sd / value) ** 2))))


def prior_log_sd(quantity: Given | Nominal, factor: float = DAMPING_FACTOR) -> float:
    """Prior deviation of the logarithm of a quantity of the car.

    Parameters
    ----------
    quantity : Given or Nominal
        As the vehicle file has it.
    factor : float
        One deviation where the file gives none, such as :data:`INERTIA_FACTOR`.
    """
    if quantity.sd is None:
        return math.log(factor)
    return log_normal_sd(quantity.value, quantity.sd)


Array = NDArray[np.float64]
Values = dict[str, Array]
"""Values (W,) of a car's parameters by name, SI units."""


@dataclass(frozen=True)
class Element:
    """A spring and a damper between the body and one wheel, or both wheels of an axle.

    Parameters
    ----------
    axle : {'front', 'rear'}
        Axle that it belongs to.
    side : {'left', 'right'} or None
        Its side; None for both sides together.
    damping, spring : str
        Names of the parameters that are its damping and its spring rate.
    """

    axle: Axle
    side: Side | None
    damping: str
    spring: str

    @property
    def name(self) -> str:
        """Its place: ``front``, ``rear_left``, ….``."""
        return self.axle if self.side is None else f"{self.axle}_{self.side}"

    @property
    def words(self) -> str:
        """Its place in words."""
        return self.name.replace("_", " ")

    def is_at(self, place: str) -> bool:
        """Whether it is at a place: itself, its axle, or ``both`` axles."""
        return place in (self.name, self.axle, "both")


@dataclass(frozen=True)
class CarParameter:
    """A parameter of a car and its prior.

    Its logarithm is normal: that of the nominal value plus the sum of independent terms, each with
    its coefficient, so that the springs of both sides of an axle share one unknown.  A fraction is
    normal itself.

    Parameters
    ----------
    name : str
        As in results.
    nominal : float
        Centre of the prior, SI units.
    terms : tuple of (str, float, float)
        Name, coefficient and standard deviation of each term; of a fraction one term of
        coefficient one.
    kind : {'estimated', 'given', 'fraction'}
        Whether it is asked for, and whether it is a fraction between zero and one.
    """

    name: str
    nominal: float
    terms: tuple[tuple[str, float, float], ...]
    kind: Literal["estimated", "given", "fraction"] = "given"


@dataclass(frozen=True)
class CarModel:
    """A car: parameters with priors, geometry, and the elements on which force laws act.

    Parameters
    ----------
    name : str
        As ``--car`` takes it.
    parameters : tuple of CarParameter
        In the order in which they are reported.
    elements : tuple of Element
        Suspension elements; each has one measured input, the acceleration of its wheel hub.
    coordinates : tuple of str
        Of the body: ``heave``, ``pitch``, ``roll``.
    inertia : callable
        From values to masses and inertias (W, n) of the coordinates.
    heights : callable
        From values to heights (W, ne, n) of the element tops per unit of the coordinates.
    point : callable
        From values and a channel on the body to the heights (W, n) of its place.
    stiffness : callable or None
        From values to the stiffness (W, ne, ne) of anti-roll bars beside the springs.
    derived : callable or None
        From values to quantities that are reported beside the parameters, each (W,).
    ratios : mapping
        Those of the derived quantities that are products of powers of parameters: their exponents.
    """

    name: str
    parameters: tuple[CarParameter, ...]
    elements: tuple[Element, ...]
    coordinates: tuple[str, ...]
    inertia: Callable[[Values], Array]
    heights: Callable[[Values], Array]
    point: Callable[[Values, Channel], Array]
    stiffness: Callable[[Values], Array] | None = None
    derived: Callable[[Values], Values] | None = None
    ratios: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names of the parameters that are asked for."""
        return tuple(p.name for p in self.parameters if p.kind == "estimated")

    @property
    def nominal(self) -> Values:
        """Nominal values, each (1,)."""
        return {p.name: np.array([p.nominal]) for p in self.parameters}

    def element_of(self, channel: Channel) -> int:
        """Return the number of the element above a wheel hub, or that a channel spans.

        Raises
        ------
        KeyError
            When the car has none there.
        """
        for e, element in enumerate(self.elements):
            if (element.axle, element.side) == (channel.axle, channel.side):
                return e
        raise KeyError(channel.name)

    def has_channel(self, channel: Channel) -> bool:
        """Whether a channel is an input or an output of this car."""
        if channel.part == "body":
            if channel.axis is not None:
                return channel.axis in self.coordinates
            if channel.side is not None and "roll" not in self.coordinates:
                return False
            return "pitch" in self.coordinates or channel.axle == self.elements[0].axle
        return any((e.axle, e.side) == (channel.axle, channel.side) for e in self.elements)

    @property
    def axles(self) -> tuple[str, ...]:
        """Its axles, in the order of the elements."""
        return tuple(dict.fromkeys(element.axle for element in self.elements))

    def elements_at(self, place: str) -> tuple[int, ...]:
        """Return the indices of the elements at a place, see :meth:`Element.is_at`."""
        return tuple(e for e, element in enumerate(self.elements) if element.is_at(place))

    def shares(self, place: str) -> Array:
        """Shares (ne,) of the elements in a force at a place, alike for all that are there."""
        out = np.zeros(len(self.elements))
        there = list(self.elements_at(place))
        out[there] = 1.0 / len(there)
        return out


@dataclass(frozen=True)
class Output:
    """A measured output and how it was filtered.

    Parameters
    ----------
    channel : Channel
        What is measured, and where.
    lead : float
        1/λ (s) for a reading that did not pass the common filter, 0 for one that did.
    """

    channel: Channel
    lead: float = 0.0


def estimated(name: str, value: Nominal, factor: float, scale: float = 1.0) -> CarParameter:
    """Parameter that is asked for, with a prior about its nominal value."""
    return CarParameter(
        name, scale * value.value, ((name, 1.0, prior_log_sd(value, factor)),), "estimated"
    )


def given(name: str, value: Given, scale: float = 1.0, kind: str = "given") -> CarParameter:
    """Parameter that is given; its deviation may be zero."""
    if kind == "fraction":
        return CarParameter(name, value.value, ((name, 1.0, value.sd),), "fraction")
    return CarParameter(name, scale * value.value, ((name, 1.0, prior_log_sd(value)),))


def constant(name: str, value: float) -> CarParameter:
    """Parameter that is exact."""
    return CarParameter(name, value, ())


def state_space(
    car: CarModel,
    values: Values,
    outputs: Sequence[Output],
    gains: tuple[Array, Array] | None = None,
    bias_directions: Array | None = None,
) -> StateSpace:
    """Linear models of a car for W sets of values.

    Parameters
    ----------
    car : CarModel
        The car.
    values : dict of str to (W,) array
        Its parameters.
    outputs : sequence of Output
        Measured outputs, ny of them.
    gains : pair of (W, ne) and (W, ny) arrays, optional
        Readings over truth of inputs and outputs; one by default.
    bias_directions : (ne, nd) array, optional
        Directions in which the inputs have a bias of their own; none by default.

    Returns
    -------
    StateSpace
        With 2 ne states, and one for each output that is the rate of a coordinate; zeros are zero.
    """
    H = car.heights(values)
    W, ne, n = H.shape
    J = np.swapaxes(H, 1, 2) / car.inertia(values)[:, :, None]  # q̈ = J F
    c = np.stack([values[e.damping] for e in car.elements], axis=1)
    k = np.stack([values[e.spring] for e in car.elements], axis=1)
    K = k[:, :, None] * np.eye(ne)
    if car.stiffness is not None:
        K = K + car.stiffness(values)
    rates = {y: o.channel.axis for y, o in enumerate(outputs) if o.channel.axis is not None}
    nx = 2 * ne + len(rates)
    by_states = np.zeros((W, n, nx))  # q̈
    by_states[:, :, 0 : 2 * ne : 2] = -J @ K
    by_states[:, :, 1 : 2 * ne : 2] = -J * c[:, None, :]
    A, B, E = np.zeros((W, nx, nx)), np.zeros((W, nx, ne)), np.zeros((W, nx, ne))
    A[:, 1 : 2 * ne : 2] = H @ by_states
    E[:, 1 : 2 * ne : 2] = H @ J
    for e in range(ne):
        A[:, 2 * e, 2 * e + 1] = 1.0
        B[:, 2 * e + 1, e] = -1.0 if gains is None else -1.0 / gains[0][:, e]
    own = dict(zip(rates, range(2 * ne, nx), strict=True))
    for y, axis in rates.items():
        turning = car.coordinates.index(axis)
        A[:, own[y]], E[:, own[y]] = by_states[:, turning], J[:, turning]
    C, G = np.zeros((W, len(outputs), nx)), np.zeros((W, len(outputs), ne))
    motion = Motion(car, values, by_states, J)
    for y, output in enumerate(outputs):
        equation = OUTPUTS[output.channel.quantity]
        C[:, y], G[:, y] = equation.rows(motion, output.channel, own.get(y, -1), output.lead)
    if gains is not None:
        C *= gains[1][:, :, None]
        G *= gains[1][:, :, None]
    N = np.zeros((ne, 0)) if bias_directions is None else bias_directions
    biases = np.zeros((W, ne + len(outputs)))
    return StateSpace(A, B, C, E, G, np.stack([c, k], axis=2), N, biases)


def bias_directions(system: StateSpace) -> Array:
    """Directions (nu, nd) of input biases that no constant state and output bias can absorb.

    A constant input β is absorbed when A x + B β = 0 has a solution: it then shifts the state and
    the outputs by constants.  What is left are the directions in which B β has a component along
    the left null space of A: motion of four wheels that no rigid body follows, or a pitch
    acceleration where a pitch rate is measured.
    """
    A, B = system.A[0], system.B[0]
    scale = np.max(np.abs(A))
    left, strength, _ = np.linalg.svd(A / scale)
    null = left[:, strength < 1e-10]
    if null.shape[1] == 0:
        return np.zeros((B.shape[1], 0))
    _, size, directions = np.linalg.svd(null.T @ B)
    return np.ascontiguousarray(directions[: np.count_nonzero(size > 1e-10)].T)


def fastest_rate(system: StateSpace) -> float:
    """Largest absolute eigenvalue of the first parameter set, rad/s."""
    return float(np.max(np.abs(np.linalg.eigvals(system.A[0]))))


def initial_covariance(system: StateSpace, outputs: Sequence[Output]) -> Array:
    """Prior covariance of (x, d, b) when a recording begins, of one parameter set.

    Deflections have a standard deviation of 0.1 m, their rates 1 m/s, body rates 1 rad/s.  Each
    sensor has a bias of its own: the ``offset`` of its output equation.  What a bias of the inputs
    does to the outputs in the long run is part of theirs; its components along the columns of N are
    d.
    """
    A, B, C, N = system.A[0], system.B[0], system.C[0], system.N
    nx, nu = B.shape
    nd, ny = N.shape[1], len(C)
    out = np.zeros((nx + nd + ny, nx + nd + ny))
    ne = system.E.shape[2]
    deviation = np.array([_DEFLECTION, _RATE] * ne + [_BODY_RATE] * (nx - 2 * ne))
    out[:nx, :nx] = np.diag(deviation**2)
    hub = OUTPUTS["acceleration"].offset
    out[nx : nx + nd, nx : nx + nd] = hub**2 * np.eye(nd)
    absorbed = np.eye(nu) - N @ N.T
    scale = np.max(np.abs(A))
    through = -C @ np.linalg.pinv(A / scale, rcond=1e-10) @ (B / scale) @ absorbed
    own = np.diag([OUTPUTS[o.channel.quantity].offset ** 2 for o in outputs])
    out[nx + nd :, nx + nd :] = own + hub**2 * through @ through.T
    return out


_DEFLECTION, _RATE, _BODY_RATE = 0.1, 1.0, 1.0  # m, m/s and rad/s
