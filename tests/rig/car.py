"""The car under test: what it weighs, what holds it up, what it stands on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from .laws import LinearDamper, LinearSpring, Term
from .units import INCH, LBF_PER_INCH, LBF_S2_INCH, LBF_S2_PER_INCH, STANDARD_GRAVITY

__all__ = ["DECLARED_SDS", "SPREADS", "RigCar", "Seat", "baja", "draw", "table51", "with_terms"]

DECLARED_SDS: Final[Mapping[str, float]] = {
    "m": 0.01,
    "wdf": 0.01,
    "l": 0.0,
    "k_f": 0.05,
    "k_r": 0.05,
}
"""Relative deviations of what a team would say it knows (as in ``docs/interfaces.md``)."""

SPREADS: Final[Mapping[str, float]] = {"c_f": 0.3, "c_r": 0.3, "i": 0.2}
"""Log-normal deviations of what is to be found; well inside the estimator's priors."""


@dataclass(frozen=True)
class Seat:
    """A driver on a compliant seat: part of the sprung mass that moves by itself.

    Attributes
    ----------
    mass : float
        Moving mass, kg; it is taken *out of* the car's sprung mass.
    k, c : float
        Seat stiffness, N/m, and damping, N s/m.
    position : float
        Forward of the sprung centre of gravity, m.
    """

    mass: float
    k: float
    c: float
    position: float = -0.1


@dataclass(frozen=True)
class RigCar:
    """A half car with four degrees of freedom (both sides together), SI throughout.

    Attributes
    ----------
    m, i : float
        Sprung mass, kg, and its pitch inertia, kg m^2 (seat mass included, if any).
    wdf, l : float
        Front weight fraction of the sprung mass, and wheelbase, m.
    k_f, k_r, c_f, c_r : float
        Suspension rates of an axle, N/m and N s/m.
    m_uf, m_ur : float
        Unsprung mass of an axle, kg.
    k_tf, k_tr, c_tf, c_tr : float
        Tyre stiffness, N/m, and damping, N s/m, of an axle.
    tyre_radius, contact_patch : float
        What smooths the road for the hub: a disc of this radius rolls over it, then the height
        is averaged over a patch of this length, m. Zero leaves either out.
    tyre_lifts : bool
        False makes the tyre linear, so that it can pull: for tests against exact solutions.
    front_law, rear_law : tuple of Term
        The whole suspension law; empty means linear with ``k`` and ``c`` above.
    seat : Seat or None
        A driver that moves.
    """

    name: str
    m: float
    wdf: float
    l: float
    k_f: float
    k_r: float
    c_f: float
    c_r: float
    i: float
    m_uf: float
    m_ur: float
    k_tf: float
    k_tr: float
    c_tf: float
    c_tr: float
    tyre_radius: float = 11.0 * INCH
    contact_patch: float = 12.0 * INCH
    tyre_lifts: bool = True
    front_law: tuple[Term, ...] = ()
    rear_law: tuple[Term, ...] = ()
    seat: Seat | None = None

    @property
    def l_f(self) -> float:
        """Centre of gravity to front axle, m."""
        return self.l * (1.0 - self.wdf)

    @property
    def l_r(self) -> float:
        """Centre of gravity to rear axle, m."""
        return self.l * self.wdf

    @property
    def k_g(self) -> float:
        """Radius of gyration in pitch, m."""
        return math.sqrt(self.i / self.m)

    @property
    def zeta_f(self) -> float:
        """Damping ratio of the front as a quarter car, the reference's definition."""
        return self.c_f / (2.0 * math.sqrt(self.k_f * self.m * self.wdf))

    @property
    def zeta_r(self) -> float:
        """Damping ratio of the rear as a quarter car."""
        return self.c_r / (2.0 * math.sqrt(self.k_r * self.m * (1.0 - self.wdf)))

    @property
    def load_f(self) -> float:
        """Static force of the front tyres, N."""
        return (self.m * self.wdf + self.m_uf) * STANDARD_GRAVITY

    @property
    def load_r(self) -> float:
        """Static force of the rear tyres, N."""
        return (self.m * (1.0 - self.wdf) + self.m_ur) * STANDARD_GRAVITY

    @property
    def laws(self) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
        """Front and rear law as the simulation uses them."""
        front = self.front_law or (LinearSpring(self.k_f), LinearDamper(self.c_f))
        rear = self.rear_law or (LinearSpring(self.k_r), LinearDamper(self.c_r))
        return front, rear


def baja() -> RigCar:
    """Return the car of Table 7.1 with unsprung masses and tyres that the reference omits.

    Unsprung: 13 % and 16 % of the sprung mass (65 and 80 lbm an axle). Tyres: low-pressure ATV
    tyres, 150 lbf/in each, damped to a few per cent; wheel hop comes out near 8 Hz. They were
    chosen so that stops at the reference's speed stay just inside its sensors' range.
    """
    m = 1.294 * LBF_S2_PER_INCH
    return RigCar(
        name="2008 Cal Poly SAE Baja",
        m=m,
        wdf=0.47,
        l=68.0 * INCH,
        k_f=100.0 * LBF_PER_INCH,
        k_r=100.0 * LBF_PER_INCH,
        c_f=7.2 * LBF_PER_INCH,
        c_r=10.0 * LBF_PER_INCH,
        i=626.0 * LBF_S2_INCH,
        m_uf=0.13 * m,
        m_ur=0.16 * m,
        k_tf=300.0 * LBF_PER_INCH,
        k_tr=300.0 * LBF_PER_INCH,
        c_tf=1.0 * LBF_PER_INCH,
        c_tr=1.0 * LBF_PER_INCH,
    )


def table51() -> RigCar:
    """Return the car of Table 5.1 (k_g 10 in, ratios 0.7 and 0.5), on the baja's tyres.

    With so little inertia the chassis over an axle weighs a thirteenth of the car, and stops that
    the baja takes well clip all sensors here: give it a low bump.
    """
    m, wdf = 1.3587 * LBF_S2_PER_INCH, 0.47
    k = 100.0 * LBF_PER_INCH
    return replace(
        baja(),
        name="Table 5.1",
        m=m,
        wdf=wdf,
        l=66.0 * INCH,
        c_f=0.7 * 2.0 * math.sqrt(k * m * wdf),
        c_r=0.5 * 2.0 * math.sqrt(k * m * (1.0 - wdf)),
        i=m * (10.0 * INCH) ** 2,
        m_uf=0.13 * m,
        m_ur=0.16 * m,
    )


def draw(
    car: RigCar,
    rng: np.random.Generator,
    sds: Mapping[str, float] = DECLARED_SDS,
    spreads: Mapping[str, float] = SPREADS,
) -> RigCar:
    """Draw a true car around a nominal one.

    Parameters
    ----------
    car : RigCar
        The nominal car; one without laws of its own, since those carry rates of their own.
    rng : numpy.random.Generator
        Where the draw comes from; one number a key is drawn, in the order of the mappings.
    sds : mapping of str to float
        Relative deviations of normal draws (what is declared as known).
    spreads : mapping of str to float
        Deviations of the logarithm (what is to be found; also masses and rates of the tyres).

    Returns
    -------
    RigCar
        The same car with those fields drawn.
    """
    if car.front_law or car.rear_law:
        raise ValueError("draw the car first, then give it laws: they hold rates of their own")
    drawn = {key: getattr(car, key) * (1.0 + sd * rng.standard_normal()) for key, sd in sds.items()}
    for key, sd in spreads.items():
        drawn[key] = getattr(car, key) * math.exp(sd * rng.standard_normal())
    return replace(car, **drawn)


def with_terms(
    car: RigCar,
    where: Literal["front", "rear", "both"],
    *terms: Term,
    spring: bool = True,
    damper: bool = True,
) -> RigCar:
    """Add terms to a car's suspension.

    Parameters
    ----------
    car : RigCar
        Left as it is.
    where : {'front', 'rear', 'both'}
        Which axle.
    *terms : Term
        What comes on top of the law that is there.
    spring, damper : bool
        False takes the linear spring or damper out first: the terms then replace it.

    Returns
    -------
    RigCar
        The car with the new law; ``k_f`` ... ``c_r`` stay as the nominal truth.
    """

    def changed(law: tuple[Term, ...]) -> tuple[Term, ...]:
        kept = tuple(
            term
            for term in law
            if (spring or not isinstance(term, LinearSpring))
            and (damper or not isinstance(term, LinearDamper))
        )
        return kept + terms

    front, rear = car.laws
    if where in ("front", "both"):
        car = replace(car, front_law=changed(front))
    if where in ("rear", "both"):
        car = replace(car, rear_law=changed(rear))
    return car
