"""Records of the unscented filter for compiled code: sizes, state, model, settings and data."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import FARTHEST

__all__ = [
    "DRIFT_LAGS", "GRID", "Columns", "FilterSettings", "LawTable", "Model",
    "Sizes", "State", "Statistics", "Steps",
    "columns", "sizes", "statistics",
]  # fmt: skip

Array = NDArray[np.float64]

DRIFT_LAGS: Final = 8
"""Largest lag (readings) of the innovations' autocovariance that the drift detector uses."""
NOTHING, STATES, ALL = 0, 1, 2  # what readings are good for
GRID: Final = np.linspace(-FARTHEST, FARTHEST, 401)
"""Places of a coordinate, prior standard deviations, at which the numbers of a law are kept."""


class Sizes(NamedTuple):
    """Sizes of a filter, which are constants of its compiled recursion.

    Parameters
    ----------
    elements : int
        Suspension elements, ne; each has a measured input.
    rates : int
        Body rates that are states of their own, nr.
    coordinates : int
        Coordinates of the body, n.
    rows : int
        Accelerations, nR: of the element tops, of the coordinates of the body rates, and of other
        points of the body that are measured.
    directions : int
        Directions in which the inputs have a bias of their own, nd.
    outputs : int
        Measured outputs, ny.
    parameters : int
        Parameters of the car, gains of the sensors, and parameters of effects.
    estimands : int
        Coordinates that are reported; they come first.
    bars : int
        One for a car with anti-roll bars, else zero.
    forces : int
        Filtered forces beyond the linear springs and dampers, one an element where force laws act
        (:mod:`bayes_asv.filters.ukf_forces`), else zero.
    motion : int
        States of the motion, nx: deflections with their rates, body rates, and filtered forces.
    lasting : int
        States that a recording begins with: motion, biases and input biases.
    states : int
        All states, ns: also the filtered noise of inputs and outputs.
    """

    elements: int
    rates: int
    coordinates: int
    rows: int
    directions: int
    outputs: int
    parameters: int
    estimands: int
    bars: int
    forces: int
    motion: int
    lasting: int
    states: int


def sizes(
    *,
    elements: int,
    rates: int,
    coordinates: int,
    rows: int,
    directions: int,
    outputs: int,
    parameters: int,
    answers: int,
    bars: int,
    forces: int = 0,
) -> Sizes:
    """Return all sizes from those of car and sensors, see :class:`Sizes`."""
    motion = 2 * elements + rates + forces
    lasting = motion + outputs + directions
    return Sizes(
        elements, rates, coordinates, rows, directions, outputs, parameters, answers, bars,
        forces, motion, lasting, lasting + elements + outputs,
    )  # fmt: skip


class Statistics(NamedTuple):
    """Places in ``State.statistics``.

    Parameters
    ----------
    noise_sum, noise_weight : int
        First of ny: sum and number of normalised innovations squared, for the slow noise factor.
    fast_factor : int
        First of ny: fast noise factor.
    fault_time : int
        Time since a fast noise factor exceeded the fault threshold, s.
    review_time, snapshot_time : int
        Time since the last review and since the last snapshot, s.
    information_gain : int
        Decrease of the log-volume of the parameters' covariance factor.
    log_likelihood : int
        Of all readings.
    deviance : int
        −2 log p of the readings given the reference, up to a constant.
    long_run_variance : int
        Of the normalised innovations, largest of all outputs.
    drift_detected : int
        One while the innovations' correlation shows that parameters drift.
    motion_mean, motion_variance : int
        First of ny: recent mean and variance of the estimated output.
    last_step : int
        Length of the last step, s; zero where the motion began anew.
    white_share, white_information : int
        Share of the noise that is white although the sensor has a filter, and its information.
    length : int
        Number of places.
    """

    noise_sum: int
    noise_weight: int
    fast_factor: int
    fault_time: int
    review_time: int
    snapshot_time: int
    information_gain: int
    log_likelihood: int
    deviance: int
    long_run_variance: int
    drift_detected: int
    motion_mean: int
    motion_variance: int
    last_step: int
    white_share: int
    white_information: int
    length: int


def statistics(outputs: int) -> Statistics:
    """Return the places in ``State.statistics`` for a number of outputs."""
    ny = outputs
    s = 3 * ny
    return Statistics(
        0, ny, 2 * ny, s, s + 1, s + 2, s + 3, s + 4, s + 5, s + 6, s + 7, s + 8, s + 8 + ny,
        s + 8 + 2 * ny, s + 9 + 2 * ny, s + 10 + 2 * ny, s + 11 + 2 * ny,
    )  # fmt: skip


class Columns(NamedTuple):
    """Columns of a row of results.

    Parameters
    ----------
    mean, sd : int
        First of the coordinates of the parameters of interest, and of their standard deviations.
    deflection, deflection_sd : int
        First of the elements' deflections, m, and of their standard deviations.
    predicted, predicted_sd : int
        First of the predicted readings, SI units, and of their standard deviations.
    nis, readings : int
        Normalised innovation squared, and the number of readings in it.
    noise_factor : int
        First of the factors on the declared noise variance, one an output.
    innovation : int
        First of the normalised innovations; each given the readings of the outputs before it.
    drift : int
        As ``Statistics.drift_detected``.
    width : int
        Number of columns.
    """

    mean: int
    sd: int
    deflection: int
    deflection_sd: int
    predicted: int
    predicted_sd: int
    nis: int
    readings: int
    noise_factor: int
    innovation: int
    drift: int
    width: int


def columns(of: Sizes) -> Columns:
    """Return the columns of a row of results."""
    na, ne, ny = of.estimands, of.elements, of.outputs
    places = [0]
    for width in (na, na, ne, ne, ny, ny, 1, 1, ny, ny, 1):
        places.append(places[-1] + width)
    return Columns(*places)


class State(NamedTuple):
    """Belief of the filter; every array is changed in place.

    Parameters
    ----------
    mu, D : (p,) and (p, p) arrays
        Reference of the parameters' coordinates, and directions of the sigma points: row i is
        direction i, zero before its i-th element.
    x, J : (ns,) and (p, ns) arrays
        State at the reference, and its derivatives along the directions.
    m, F : (p,) and (p, p) arrays
        Mean and triangular factor (shaped like D) of d; zero and one for a moving reference.
    Pi : (ns, ns) array
        Covariance of the state given the parameters.
    statistics : array
        Statistics and timers; see :class:`Statistics`.
    snapshots : (2, p, 1 + p) array
        μ and D at two earlier instants at which the fast noise factor was low, older one first.
    autocovariance : (ny, 2, 1 + DRIFT_LAGS) array
        Of each output: lagged normalised innovations (row 0, newest first), and their
        exponentially weighted autocovariance by lag (row 1).
    force_history : (K, 2, ne, LANES) array
        Force and rate of deflection of each sigma point, in K blocks of lanes, at the beginning of
        the last step (:func:`bayes_asv.filters.suspension_forces.advance_forces`); empty without
        force laws.
    """

    mu: Array
    D: Array
    x: Array
    J: Array
    m: Array
    F: Array
    Pi: Array
    statistics: Array
    snapshots: Array
    autocovariance: Array
    force_history: Array


class LawTable(NamedTuple):
    """Force laws whose numbers are functions of the coordinates, one number a coordinate.

    Parameters
    ----------
    pole : float
        Of the filter that all readings passed, rad/s.
    rows : (K, P) array
        Laws at the centre of the prior; see :mod:`bayes_asv.filters.force_laws`.
    entry : (nE, 3) int array
        Row and column of a number that changes, and the parameter that it is a function of.
    number : (nE, G) array
        That number at :data:`GRID` places of the coordinate.
    """

    pole: float
    rows: Array
    entry: NDArray[np.int64]
    number: Array


class Model(NamedTuple):
    """Car and sensors.

    Parameters
    ----------
    base, element, log, centre, scale : arrays
        Parameter vector as a function of the coordinates, as in
        :func:`bayes_asv.filters.simd_batch.set_parameters`.
    factor : (p, p) array
        Prior D: its product Dᵀ D is the prior covariance of the coordinates.
    noise : (3 (ne + ny),) array
        White variance of one sample of each input and each output; variance of their noise that
        passed the sensors' filters; poles of these filters, rad/s.
    share : (ne, ny) array
        Shares of the outputs' noise factors in those of the inputs.
    start : (lasting, lasting) array
        Prior covariance of motion, biases and input biases.
    input_bias : (ne, nd) array
        Directions of the input biases.
    parameter_noise, drift_noise : (p,) arrays
        Process noise of each coordinate, variance per second; the second one, if larger, replaces
        the first while a drift is detected.
    constant : (nG,) array
        Constant terms of the geometry: heights of the element tops (ne, n), masses and inertias
        (n,), and the further rows of accelerations (nR − ne, n) per unit of the coordinates.  Each
        of these is a polynomial of the parameters.
    term : (nT, 2) int array
        Number of the polynomial that a term belongs to, and the row of the parameter that it is
        proportional to, or −1 for a term with several factors.
    coefficient : (nT,) array
        Coefficients of the terms.
    factors : (nT, 4) int array
        Rows of the parameters whose product a term with several factors is; −1 where there are
        fewer.
    place : (P + C,) int array
        Rows of the parameters in a lane, counted from ``Rows.damping``.
    copies : (nK, 2) int array
        Further rows that are the same as another: this one and that.
    uncertain_gains : bool
        Whether the gain of an input sensor is a coordinate.
    bars : (ne, ne) array
        Stiffness of anti-roll bars beside the springs.
    output_row : (ny,) int array
        Row of accelerations in each output.
    by_row : (ny,) array
        Its coefficient.
    by_state : (ny, nx) array
        Coefficients of the states beside it.
    reads_states : bool
        Whether any of these is not zero.
    laws : LawTable
        Force laws of the suspension.
    """

    base: Array
    element: NDArray[np.int64]
    log: NDArray[np.bool_]
    centre: Array
    scale: Array
    factor: Array
    noise: Array
    share: Array
    start: Array
    input_bias: Array
    parameter_noise: Array
    drift_noise: Array
    constant: Array
    term: NDArray[np.int64]
    coefficient: Array
    factors: NDArray[np.int64]
    place: NDArray[np.int64]
    copies: NDArray[np.int64]
    uncertain_gains: bool
    bars: Array
    output_row: NDArray[np.int64]
    by_row: Array
    by_state: Array
    reads_states: bool
    laws: LawTable


class FilterSettings(NamedTuple):
    """Thresholds of gating, noise adaptation, fault and drift detection, and relinearisation.

    Parameters
    ----------
    gate : float
        Normalised innovation squared beyond which a reading's variance is inflated until it has
        this value.
    prior_readings : float
        Number of readings that the declared noise variance is worth.
    slow_window, fast_window : float
        Time constants (readings) of the slow and of the fast noise factor.
    fast_threshold : float
        Fast noise factor from which on it replaces the slow one.
    fault_threshold : float
        Fast noise factor beyond which something other than noise is at fault.
    fault_duration : float
        Time (s) beyond that threshold after which the filter is reset.
    drift_threshold : float
        Long-run variance of the normalised innovations, one if they are white, beyond which
        parameters are taken to drift; the detection ends below its square root.
    information_gain : float
        Information gain (nats) about the parameters after which the filter is relinearised.
    review_interval : float
        Time (s) after which the filter's window is reviewed in any case.
    """

    gate: float
    prior_readings: float
    slow_window: float
    fast_window: float
    fast_threshold: float
    fault_threshold: float
    fault_duration: float
    drift_threshold: float
    information_gain: float
    review_interval: float


class Steps(NamedTuple):
    """N time steps, each with the readings at its end.

    Parameters
    ----------
    step : (N,) array
        Length, s.
    moments : (N, ne, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of the measured inputs over each step.
    spread : (N, 2 ne) array
        What turns the variance of an input's sample into the intensity of process noise (s), and
        the intensity that is added for what the input did between its samples (m²/s³), one an
        input each.
    kind : (N, ny) int8 array
        Kind of the reading of each output: ``MISSING``, ``VALUE``, ``AT_LEAST`` or ``AT_MOST``.
    reading : (N, ny) array
        Those readings or the rails that they reached, SI units.
    restart : (N,) bool array
        Steps over which the inputs are unknown: the motion starts anew at their ends.
    ends : (N, 2, ne) array
        Measured inputs at the beginning and at the end of each step, m/s².
    use : (N,) int8 array
        What the readings at its end are good for: ``NOTHING``, ``STATES`` (they do not test the
        noise) or ``ALL``; those of a car that stands still on coarse converters are good for less.
    """

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    reading: Array
    restart: NDArray[np.bool_]
    ends: Array
    use: NDArray[np.int8]
