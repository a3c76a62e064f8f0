"""Experiment design: rate every candidate drive for a vehicle and choose one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.progress import Progress
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.planning.drives import KINDS, RATES, Drive, RoadProfile, candidate_drives
from bayes_asv.planning.evaluation import Evaluation, MeasuredCar, evaluate, measured_car
from bayes_asv.planning.measurement import with_default_noise
from bayes_asv.planning.predicted_sd import (
    LimitingValues,
    limiting_values,
    predicted_sd,
    required_passes,
    sd_floors,
)
from bayes_asv.planning.ride_simulation import Motion, Pass, Tyres, default_tyres, simulate_passes
from bayes_asv.posterior.information import ParameterPrior
from bayes_asv.posterior.threads import threads
from bayes_asv.simulation.simulate import usual_channels

__all__ = ["PlanResult", "RatedDrive", "plan"]

RoadAndSpeed = tuple[RoadProfile, float]

_ROAD_REALISATIONS = 2  # rough roads averaged, since roads of one class differ
# The first kind of road in KINDS is preferred (a bump is easy to build and repeatable) unless the
# standard deviations of its best drive exceed those of the best drive of all by this factor.
_MAX_LOSS_OF_EASIER_KIND = 3.0
# Of that kind, the slowest drive is chosen whose deviations are within this factor of the best.
_EQUIVALENT = 1.3
_NEGLIGIBLE_LOSS = 1.05  # factor on the standard deviation


@dataclass(frozen=True)
class RatedDrive:
    """A candidate drive with its required number of passes.

    Parameters
    ----------
    evaluation : Evaluation
        The drive and its Fisher information.
    required_passes : dict of str to int or None
        Passes that reach the wanted standard deviation of each parameter of interest; None if no
        number does or the drive cannot be used.
    worst_ratio : float
        Largest ratio of predicted to wanted standard deviation after one pass, with all given
        values exact, which measures the drive alone.
    """

    evaluation: Evaluation
    required_passes: Mapping[str, int | None]
    worst_ratio: float

    @property
    def passes(self) -> int | None:
        """Passes that reach all wanted standard deviations, None where no number does."""
        required = [n for n in self.required_passes.values() if n is not None]
        return max(required) if len(required) == len(self.required_passes) else None


@dataclass(frozen=True)
class PlanResult:
    """The rated drives, the recommended one and what limits it.

    Parameters
    ----------
    vehicle : Vehicle
        Contents of the vehicle file.
    measured : MeasuredCar
        Model of the car, and the sensors at hand.
    assumed_noise : tuple of str
        Channels whose noise the vehicle file does not give.
    tyres : Tyres
        Tyres and unsprung masses of the simulated car.
    tyres_given : bool
        Whether both their rate and the unsprung mass were given.
    want : Mapping of str to float
        Wanted relative standard deviation of each parameter.
    max_passes : int
        Largest number of passes to recommend.
    rated : tuple of RatedDrive
        All candidate drives.
    chosen : RatedDrive or None
        The recommended drive; None if none suffices.
    best : RatedDrive or None
        The recommended drive, or else the nearest one; None if no drive can be used.
    passes : int
        Recommended number of passes, enough for all wanted standard deviations or until further
        passes gain nothing substantial; 0 if no drive can be used.
    sd_floor : dict of str to float
        Relative standard deviation of each parameter in the limit of infinitely many passes.
    limits : tuple of LimitingValues
        Given values that limit each parameter whose standard deviation stays too large.
    seed : int
        Seed of rough roads and noise.
    """

    vehicle: Vehicle
    measured: MeasuredCar
    assumed_noise: tuple[str, ...]
    tyres: Tyres
    tyres_given: bool
    want: Mapping[str, float]
    max_passes: int
    rated: tuple[RatedDrive, ...]
    chosen: RatedDrive | None
    best: RatedDrive | None
    passes: int
    sd_floor: Mapping[str, float]
    limits: tuple[LimitingValues, ...]
    seed: int

    @property
    def prior(self) -> ParameterPrior:
        """Parameters of the car with their prior standard deviations."""
        return self.measured.about

    @property
    def estimands(self) -> tuple[str, ...]:
        """Names of the parameters whose standard deviations are predicted."""
        return tuple(self.prior.estimands)

    @property
    def verdict(self) -> str:
        """``ok``, or ``refused`` if no candidate drive suffices."""
        return "ok" if self.chosen is not None else "refused"

    def sd_after(self, drive: RatedDrive, passes: int) -> Mapping[str, float]:
        """Predict the relative standard deviations after a number of passes of a drive."""
        return predicted_sd(drive.evaluation.information, passes, self.prior)


def plan(
    vehicle: Vehicle,
    want: Mapping[str, float],
    *,
    car: str = "half",
    channels: Sequence[str] | None = None,
    rates: Sequence[float] = RATES,
    kinds: Sequence[str] = KINDS,
    speed_limit: float = math.inf,
    max_passes: int = 10,
    tyre_rate: float | None = None,
    unsprung: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> PlanResult:
    """Rate every candidate drive and choose one.

    Parameters
    ----------
    vehicle : Vehicle
        Its nominal values are taken as true, its sensors as declared.
    want : Mapping of str to float
        Wanted posterior standard deviations of the parameters of interest, relative to the values.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.
    channels : sequence of str, optional
        Sensors at hand; by default accelerometers on all wheel hubs and on the body above them.
    rates, kinds : sequences of float and str
        Sampling rates, Hz, and kinds of road to consider.
    speed_limit : float
        Largest speed, m/s.
    max_passes : int
        Largest acceptable number of passes.
    tyre_rate, unsprung : float, optional
        Tyre rate and unsprung mass of one axle, both sides together, N/m and kg; typical values by
        default.
    seed : int
        Seed of rough roads and noise.
    progress : callable, optional
        Called with the fraction done and a description.

    Returns
    -------
    PlanResult

    Raises
    ------
    InputError
        If the vehicle is implausible, or the channels do not fit the car.
    """
    report = progress or (lambda share, words: None)
    model = car_model(car, vehicle)
    sensors = _channels(vehicle, model, channels)
    noisy, assumed = with_default_noise(vehicle, sensors)
    measured = measured_car(noisy, model, sensors)
    prior = measured.about
    grid = candidate_drives(model, vehicle.units, rates, kinds, speed_limit)
    report(0.0, "simulating drives")
    tyres = default_tyres(model, tyre_rate, unsprung)
    motions = _simulate_grid(measured, tyres, grid, seed)
    report(0.1, "evaluating drives")
    evaluations: list[Evaluation] = []
    keys = list(motions)

    def evaluate_all_rates(key: RoadAndSpeed) -> list[Evaluation]:
        drives = [drive for drive in grid if (drive.road, drive.speed) == key]
        return evaluate(measured, drives, motions[key], seed)

    with threads() as pool:
        for of_key in pool.map(evaluate_all_rates, keys):
            evaluations += of_key
            report(0.1 + 0.85 * len(evaluations) / len(grid), "evaluating drives")
    rated = tuple(_rate(evaluation, prior, want) for evaluation in evaluations)
    chosen = _choose(rated, max_passes)
    best = chosen or _nearest(rated, prior, want, max_passes)
    limits: list[LimitingValues] = []
    if best is not None and chosen is None:
        for name in prior.estimands:
            limiting = limiting_values(
                best.evaluation.information, max_passes, prior, name, want[name]
            )
            if limiting is not None:
                limits.append(limiting)
    report(1.0, "done")
    return PlanResult(
        vehicle=vehicle,
        measured=measured,
        assumed_noise=assumed,
        tyres=tyres,
        tyres_given=tyre_rate is not None and unsprung is not None,
        want=dict(want),
        max_passes=max_passes,
        rated=rated,
        chosen=chosen,
        best=best,
        passes=_recommended_passes(best, prior, want, max_passes),
        sd_floor=sd_floors(prior),
        limits=tuple(limits),
        seed=seed,
    )


def _channels(vehicle: Vehicle, car: CarModel, names: Sequence[str] | None) -> tuple[Channel, ...]:
    """Channels of a plan.

    Raises
    ------
    InputError
        If one is not of the car, a wheel hub is missing, or nothing else is measured.
    """
    channels = tuple(vehicle.channel(name) for name in names or usual_channels(car))
    for channel in channels:
        if not car.has_channel(channel):
            raise InputError(
                f"channel '{channel.name}'", f"is not one of the {car.name} car",
                "leave it out, or choose another car",
            )  # fmt: skip
    for element in car.elements:
        hub = f"{element.name}_wheel"
        if hub not in [channel.name for channel in channels]:
            raise InputError(
                "channels", f"lack {hub}, which the {car.name} car needs",
                "add an accelerometer on that wheel hub, or choose another car",
            )  # fmt: skip
    if all(channel.is_input for channel in channels):
        raise InputError(
            "channels", "measure nothing that the car explains",
            "add the acceleration of the body, its pitch rate or the suspension travel",
        )  # fmt: skip
    return channels


def _simulate_grid(
    measured: MeasuredCar, tyres: Tyres, grid: Sequence[Drive], seed: int
) -> dict[RoadAndSpeed, list[Motion]]:
    """Simulate each road at each speed, which is independent of the sampling rate."""
    passes: dict[RoadAndSpeed, list[Pass]] = {}
    for drive in grid:
        roads = _ROAD_REALISATIONS if drive.road.kind == "rough" else 1
        passes[drive.road, drive.speed] = [
            Pass(drive.road, drive.speed, drive.seconds, seed + k) for k in range(roads)
        ]
    flat = [one for of_key in passes.values() for one in of_key]
    motions = iter(simulate_passes(measured.car, tyres, flat, measured.channels) if flat else [])
    return {key: [next(motions) for _ in of_key] for key, of_key in passes.items()}


def _ratio(sd: Mapping[str, float], want: Mapping[str, float]) -> float:
    """Return the largest ratio of predicted to wanted standard deviation."""
    return max(sd[name] / want[name] for name in sd)


def _rate(evaluation: Evaluation, prior: ParameterPrior, want: Mapping[str, float]) -> RatedDrive:
    if not evaluation.usable:
        return RatedDrive(evaluation, dict.fromkeys(prior.estimands), math.inf)
    exact = predicted_sd(evaluation.information, 1, prior.with_exact_given())
    required = required_passes(evaluation.information, prior, want)
    return RatedDrive(evaluation, required, _ratio(exact, want))


def _choose(rated: Sequence[RatedDrive], max_passes: int) -> RatedDrive | None:
    """Prefer gentle drives, then few passes, then little effort."""
    usable = [(one, one.passes) for one in rated if one.evaluation.usable]
    sufficient = [(one, n) for one, n in usable if n is not None and n <= max_passes]
    gentle = [(one, n) for one, n in sufficient if one.evaluation.gentle]
    for candidates in (gentle, sufficient):
        if candidates:
            fewest = min(n for _, n in candidates)
            return _easiest([one for one, n in candidates if n == fewest])
    return None


def _easiest(candidates: Sequence[RatedDrive]) -> RatedDrive:
    """Return the drive of least effort among those about as informative as the best."""
    best: dict[str, float] = {}
    for one in candidates:
        kind = one.evaluation.drive.road.kind
        best[kind] = min(best.get(kind, math.inf), one.worst_ratio)
    worst = _MAX_LOSS_OF_EASIER_KIND * min(best.values())
    kind = next(kind for kind in KINDS if best.get(kind, math.inf) <= worst)
    informative = [
        one
        for one in candidates
        if one.evaluation.drive.road.kind == kind and one.worst_ratio <= _EQUIVALENT * best[kind]
    ]

    def effort(one: RatedDrive) -> tuple[float, float, float]:
        drive = one.evaluation.drive
        return drive.speed, drive.road.height, drive.rate

    return min(informative, key=effort)


def _worst_ratio(
    one: RatedDrive, passes: int, prior: ParameterPrior, want: Mapping[str, float]
) -> float:
    """Return the largest ratio of predicted to wanted standard deviation."""
    return _ratio(predicted_sd(one.evaluation.information, passes, prior), want)


def _nearest(
    rated: Sequence[RatedDrive], prior: ParameterPrior, want: Mapping[str, float], max_passes: int
) -> RatedDrive | None:
    """Return the drive that comes nearest to the wanted values, a gentle one if about as good."""
    usable = [
        (one, _worst_ratio(one, max_passes, prior, want)) for one in rated if one.evaluation.usable
    ]
    if not usable:
        return None
    enough = _NEGLIGIBLE_LOSS * min(worst for _, worst in usable)
    nearly_best = [one for one, worst in usable if worst <= enough]
    # where a given value limits the result, all good drives have about the same ratio: keep those
    # that suffice once that value is measured better
    nearly_best = [
        one for one in nearly_best if _ratio_of_drive_alone(one, max_passes) <= 1.0
    ] or nearly_best
    return _easiest([one for one in nearly_best if one.evaluation.gentle] or nearly_best)


def _recommended_passes(
    best: RatedDrive | None, prior: ParameterPrior, want: Mapping[str, float], max_passes: int
) -> int:
    """Return the smallest number of passes after which further ones gain nothing substantial."""
    if best is None:
        return 0
    enough = max(1.0, _NEGLIGIBLE_LOSS * _worst_ratio(best, max_passes, prior, want))
    of_drive_alone = max(1.0, _ratio_of_drive_alone(best, max_passes))

    def suffices(n: int) -> bool:
        return (
            _worst_ratio(best, n, prior, want) <= enough
            and _ratio_of_drive_alone(best, n) <= of_drive_alone
        )

    return next((n for n in range(1, max_passes) if suffices(n)), max_passes)


def _ratio_of_drive_alone(one: RatedDrive, passes: int) -> float:
    """Return the largest ratio of predicted to wanted deviation with all given values exact."""
    return one.worst_ratio / math.sqrt(passes)
