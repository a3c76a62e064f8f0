"""Changes between two sessions against dense Gaussians and against sampling both together."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from bayes_asv.analysis.random_effects import RunLikelihood
from bayes_asv.analysis.run_consistency import SingleRunFit, fit_single_run
from bayes_asv.analysis.session_changes import (
    CHANGE_SD,
    UNCHANGED,
    Session,
    SessionChanges,
    session,
    session_changes,
)
from bayes_asv.domain.vehicle import Given, Nominal, Vehicle
from bayes_asv.posterior.importance import importance_sample
from bayes_asv.posterior.likelihood import Posterior, shared_work
from bayes_asv.posterior.newton import PosteriorMode
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from benchmarks import compare as bench
from tests.posterior.cases import DECLARED, as_recording, case, prepared, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, SensorSpec, baja, draw, draw_biases, drive

Array = NDArray[np.float64]
NAMES = ("c_f", "c_r", "i")


@pytest.fixture(scope="module")
def known() -> Vehicle:
    """Return the rig's car as declared."""
    return vehicle(DECLARED)


@cache
def _space(known: Vehicle) -> ParameterSpace:
    """Return the coordinates of one drive of a vehicle."""
    _, _, recording = case("bump", 1, DECLARED)
    return make_parameter_space(known, (prepared(recording, known),))


def _session(where: ParameterSpace, information: Array, reading: Array) -> Session:
    """Return a session that read A y + unit noise of its coordinates y."""
    likelihood = RunLikelihood(information.T @ information, information.T @ reading)
    return Session(where, {}, likelihood)


def _by_density(
    where: tuple[ParameterSpace, ParameterSpace],
    own: tuple[str, ...],
    information: tuple[Array, Array],
    readings: Array,
) -> tuple[Array, Array]:
    """Probabilities of a fall and of a rise, from the density of all readings under every set.

    The unknowns are spelled out one by one: what is common, what each session has of its own, and
    the changes.
    """
    first = where[0]
    terms = sorted({t[0] for p in first.car.parameters for t in p.terms if t[2] > 0.0} - {"wdf"})
    unknowns = [*terms, "wdf", *(f"{name} after" for name in own)]
    columns = {name: k for k, name in enumerate(unknowns)}
    n, changes = len(unknowns), len(NAMES)
    ways, offsets = [], []
    for session_number, one in enumerate(where):
        zeta, shift = np.zeros((len(terms), n + changes)), np.zeros(len(terms))
        for row, term in enumerate(terms):
            again = session_number == 1 and term in own
            zeta[row, columns[f"{term} after" if again else term]] = 1.0
            if session_number == 1 and term in NAMES:
                (m1, s1), (m2, s2) = (of.log_prior_of(term) for of in where)
                zeta[row, columns[term]] = s1 / s2
                zeta[row, n + NAMES.index(term)] = 1.0 / s2
                shift[row] = (m1 - m2) / s2
        fraction = np.zeros((1, n + changes))
        fraction[0, columns["wdf"]] = 1.0
        ways.append(np.vstack([one.prior.identified.T @ zeta, fraction]))
        offsets.append(np.append(one.prior.identified.T @ shift, 0.0))
    A = np.vstack([a @ way for a, way in zip(information, ways, strict=True)])
    mean = np.concatenate([a @ o for a, o in zip(information, offsets, strict=True)])
    total, lower, higher = 0.0, np.zeros(changes), np.zeros(changes)
    parts = []
    for chosen in product((0.0, 1.0), repeat=changes):
        prior = np.diag([*np.ones(n), *(CHANGE_SD**2 * np.array(chosen))])
        covariance = A @ prior @ A.T + np.eye(len(A))
        log_density = multivariate_normal(mean, covariance).logpdf(readings)
        gain = prior @ A.T @ np.linalg.inv(covariance)
        u = (gain @ (readings - mean))[n:]
        sd = np.sqrt(np.maximum(np.diag(prior - gain @ A @ prior)[n:], 0.0))
        size = sum(chosen)
        weight = UNCHANGED ** (changes - size) * (1.0 - UNCHANGED) ** size
        parts.append((log_density + math.log(weight), chosen, u, sd))
    top = max(part[0] for part in parts)
    for log_weight, chosen, u, sd in parts:
        weight = math.exp(log_weight - top)
        total += weight
        for k, there in enumerate(chosen):
            if there:
                below = 0.5 * math.erfc(u[k] / (sd[k] * math.sqrt(2.0)))
                lower[k] += weight * below
                higher[k] += weight * (1.0 - below)
    return lower / total, higher / total


@given(seed=st.integers(0, 2**32 - 1), sharp=st.floats(1.0, 300.0))
@settings(max_examples=15, deadline=None)
def test_probabilities_are_those_of_the_density_of_the_readings(seed: int, sharp: float) -> None:
    known = vehicle(DECLARED)
    other = replace(
        known, m=Given(1.1 * known.m.value, 0.02 * known.m.value),
        c_f=Nominal(0.8 * known.c_f.value),
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    for after, own in ((known, ()), (other, ("m",))):
        both = _space(known), _space(after)
        size = both[0].car_dimension
        information = tuple(sharp * rng.standard_normal((size, size)) for _ in both)
        readings = rng.standard_normal(2 * size) + sharp * 0.1 * rng.standard_normal(2 * size)
        found = session_changes(
            *(
                _session(one, a, y)
                for one, a, y in zip(both, information, np.split(readings, 2), strict=True)
            )
        )
        lower, higher = _by_density(both, own, (information[0], information[1]), readings)
        assert found.names == NAMES
        assert found.lower == pytest.approx(lower, rel=1e-5, abs=1e-9)
        assert found.higher == pytest.approx(higher, rel=1e-5, abs=1e-9)
        assert np.all(found.lower + found.higher <= 1.0 + 1e-12)
        assert 0.0 <= found.nothing <= 1.0


def test_a_scale_error_of_a_sensor_that_stayed_is_no_change(known: Vehicle) -> None:
    """A reading of c_f times the scale of a sensor, in both sessions."""
    where = _space(known)
    n = where.car_dimension
    damping = where.log_slopes("c_f")
    way = np.zeros(n + 1)
    way[: len(damping)] = damping
    way[n] = 0.05  # of a sensor whose scale is given to 5 %
    H = np.outer(way, way) * 1e6
    quantity = np.append(np.zeros(n), 1.0)

    def of(sensor: str, reading: float) -> Session:
        return Session(where, {"front_chassis": (sensor,)}, RunLikelihood(H, 1e6 * reading * way))

    same = session_changes(of("a", 0.04), of("a", 0.04))
    replaced = session_changes(of("a", 0.04), of("b", 0.04))
    assert quantity @ H @ quantity > 0.0
    assert same.sd[0] == pytest.approx(math.sqrt(2e-6), rel=0.05)
    assert replaced.sd[0] == pytest.approx(math.sqrt(2.0) * 0.05, rel=0.1)


def test_sessions_that_say_nothing_leave_the_prior(known: Vehicle) -> None:
    where = _space(known)
    silent = RunLikelihood(np.zeros(2 * (where.car_dimension,)), np.zeros(where.car_dimension))
    found = session_changes(Session(where, {}, silent), Session(where, {}, silent))
    assert found.lower + found.higher == pytest.approx(1.0 - UNCHANGED)
    assert found.lower == pytest.approx(found.higher)
    assert found.sd == pytest.approx(CHANGE_SD)
    assert np.all(np.isnan(found.p_values))
    assert math.isnan(found.p_value)
    assert math.isnan(found.rest.p)


class _Together:
    """Both sessions as one density: a common car, changes, and the nuisances of each."""

    def __init__(self, first: Posterior, second: Posterior, way: Array):
        self.first, self.second, self.way = first, second, way
        self.n, self.p = way.shape
        self.split = self.n + self.p + first.space.dimension - self.n

    def log_posterior(self, z: Array) -> Array:
        """Log density (W,), not normalised."""
        car, u = z[:, : self.n], z[:, self.n : self.n + self.p]
        own = z[:, self.n + self.p : self.split], z[:, self.split :]
        both = np.hstack([car, own[0]]), np.hstack([car + u @ self.way.T, own[1]])
        value = self.first.log_posterior(both[0]) - 0.5 * np.sum(u**2, axis=1) / CHANGE_SD**2
        value += self.second.log_posterior(both[1]) - self.second.space.log_prior(both[1])
        return np.asarray(value - 0.5 * np.sum(own[1] ** 2, axis=1))


def test_two_summaries_are_as_good_as_sampling_both_sessions_together(known: Vehicle) -> None:
    """Two drives of a rig car whose front damper changed; the given values are off."""
    rng = np.random.default_rng(7)
    car = draw(baja(), rng, DECLARED)
    spec = draw_biases(SensorSpec(), rng)
    fits: list[SingleRunFit] = []
    for own, road in ((car, "bump"), (replace(car, c_f=0.9 * car.c_f), "stops")):
        run = drive(own, TERRAINS[road](3), DEFAULT_SPEEDS[road], 400.0, 2.0, spec, len(fits))
        fits.append(fit_single_run(prepared(as_recording(run, road), known), known, 0))
    found = _changes_of(fits, known)
    where = fits[0].fit.space
    n = where.car_dimension
    way = np.stack([where.from_logs({name: 1.0})[:n] for name in NAMES], axis=1)
    posterior = _Together(fits[0].fit.posterior, fits[1].fit.posterior, way)
    # A proposal from both modes: the precision of each, moved to the common coordinates.
    size = posterior.split + fits[1].fit.space.dimension - n
    precision, linear = np.zeros((size, size)), np.zeros(size)
    precision[:n, :n] = np.eye(n)
    precision[n : n + 3, n : n + 3] = np.eye(3) / CHANGE_SD**2
    for number, one in enumerate(fits):
        d = one.fit.space.dimension
        M = np.zeros((d, size))
        M[:n, :n] = np.eye(n)
        start = posterior.split if number else n + 3
        M[n:, start : start + d - n] = np.eye(d - n)
        if number:
            M[:n, n : n + 3] = way
        H = np.linalg.inv(one.fit.mode.covariance)
        h = H @ one.fit.mode.z
        H[:n, :n] -= np.eye(n)
        precision += M.T @ H @ M
        linear += M.T @ h
    covariance = np.linalg.inv(precision)
    mode = PosteriorMode(covariance @ linear, covariance, 0.0, converged=True)
    with shared_work(fits[0].fit.posterior) as first:
        posterior.first = first
        posterior.second = replace(fits[1].fit.posterior, pool=first.pool)
        draws = importance_sample(posterior, mode, 4096, 0)
    assert draws.effective > 300.0
    for k, name in enumerate(NAMES):
        u = draws.z[:, n + k]
        assert found.mean[k] == pytest.approx(draws.mean(u), abs=0.2 * draws.sd(u)), name
        assert found.sd[k] == pytest.approx(draws.sd(u), rel=0.1), name
    assert found.mean[0] == pytest.approx(math.log(0.9), abs=4.0 * found.sd[0])


def _changes_of(fits: list[SingleRunFit], known: Vehicle) -> SessionChanges:
    sessions = []
    for one in fits:
        where = one.fit.space
        sessions.append(session(where, known, one.z[:, : where.car_dimension], {}))
    return session_changes(*sessions)


def test_changes_of_rig_cars_are_found_and_others_are_not() -> None:
    """The bench in short; its results of hundreds of pairs are in docs/compare.md."""
    rows = [bench.pair(11, number) for number in range(4)]
    assert all("refused" not in row for row in rows)
    for row in rows:
        true = np.array([row["change"][name] for name in NAMES])
        z = (np.array(row["mean"]) - true) / np.array(row["sd"])
        assert np.all(np.abs(z) < 4.5), row
        if row["pair"] % 2 == 0:  # the sensors of the logger
            changed = np.array(row["lower"]) + np.array(row["higher"])
            assert np.all(changed[np.abs(true) > 0.02] > 0.99)
            assert np.all(changed[true == 0.0] < 0.5)


@given(seed=st.integers(0, 1000))
@settings(max_examples=5, deadline=None)
def test_the_calibration_error_sees_overconfidence(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = rng.random(5000)
    fair = (rng.random(5000) < p).astype(float)
    assert bench.calibration_error(p, fair) < 0.03
    assert bench.calibration_error(np.where(p > 0.5, 0.5 + 0.5 * p, 0.5 * p), fair) > 0.08
