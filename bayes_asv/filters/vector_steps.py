"""Prediction and update of a Kalman filter over vectors of parameter sets.

The model is that of :mod:`.prediction`, with the forces of :mod:`.suspension_forces`.  Shapes are
given without the lanes.  Of the covariance P only the lower triangle is read and written.
"""

from __future__ import annotations

from bayes_asv.filters.force_laws import LAW_PARTS
from bayes_asv.filters.prediction import ORDER, STEP_SERIES, TAYLOR
from bayes_asv.filters.vector_code import Choice, Shared, Table, Vector, emitted, plus, products

__all__ = [
    "advance_mean_vectors", "begin_forces_vectors", "begin_laws_vectors", "condition_vectors",
    "discretize_vectors", "end_forces_vectors", "end_laws_vectors", "feedback_vectors",
    "linearise_vectors",
    "predict_vectors", "project_vectors", "rate_vectors",
]  # fmt: skip


class _Symmetric:
    """The lower triangle of a matrix, read once."""

    def __init__(self, table: Table, n: int) -> None:
        self._table = table
        self._entries = {(a, b): table[a, b] for a in range(n) for b in range(a + 1)}

    def __getitem__(self, index: tuple[int, int]) -> Vector:
        return self._entries[max(index), min(index)]

    def __setitem__(self, index: tuple[int, int], value: Vector) -> None:
        self._table[max(index), min(index)] = value


@emitted
def discretize_vectors(
    nx: int,
    nd: int,
    nu: int,
    rows: int,
    coupled: int,
    weights: Shared,
    powers: Table,
    B: Table,
    N: Shared,
    carry: Table,
    Q: Table,
) -> None:
    """Fill what a step needs.

    Parameters
    ----------
    nx, nd, nu, rows, coupled : int
        States of the car, biases, inputs; as of :func:`predict_vectors`.
    weights : (STEP_SERIES, TAYLOR + 1) array
        Of the step, of :func:`.prediction.step_weights`.
    powers : (TAYLOR + 1, nx, nx) table
        Aʲ/j!.
    B, N : (nx, nu) table and (nu, nd) array
        Of the inputs, and of their biases.
    carry : (rows, coupled) table
        Gets Φ, −Γ N and −Γ in its first nx rows; its columns from nx to ``rows`` are left alone.
    Q : (nu, nx, nx) table
        Gets ∫ Φ B Bᵀ Φᵀ ds for each input, exact to the fourth power of the step.
    """
    weights, powers = weights.shaped(STEP_SERIES, TAYLOR + 1), powers.shaped(TAYLOR + 1, nx, nx)
    B, N, carry, Q = (
        B.shaped(nx, nu),
        N.shaped(nu, nd),
        carry.shaped(rows, coupled),
        Q.shaped(nu, nx, nx),
    )
    factors = [[weights[row, j] for j in range(TAYLOR + 1)] for row in range(STEP_SERIES)]
    by_input = {(c, u): B[c, u] for c in range(nx) for u in range(nu)}
    impulses = {}
    for a in range(nx):
        sums = []
        for b in range(nx):
            terms = [powers[j, a, b] for j in range(TAYLOR + 1)]
            # the smallest terms first
            sums.append([products(zip(terms[::-1], own[::-1], strict=True)) for own in factors])
            carry[a, b] = sums[b][0]
        for u in range(nu):
            _, lasting, *nodes = (
                products((sums[c][row], by_input[c, u]) for c in range(nx))
                for row in range(STEP_SERIES)
            )
            carry[a, coupled - nu + u] = lasting
            impulses[a, u] = nodes
        for d in range(nd):
            carry[a, rows + d] = products((carry[a, coupled - nu + u], N[u, d]) for u in range(nu))
    for u in range(nu):
        for a in range(nx):
            for b in range(nx):
                Q[u, a, b] = products(zip(impulses[a, u], impulses[b, u], strict=True))


@emitted
def advance_mean_vectors(
    nx: int,
    nu: int,
    rows: int,
    coupled: int,
    n: int,
    columns: int,
    carry: Table,
    drive: Table,
    moments: Shared,
    mean: Table,
    ahead: Table,
) -> None:
    """Fill ``ahead`` (rows, columns), the first rows of the state's mean after a step.

    ``moments`` (nu, ORDER) are those of the inputs over it, ``drive`` (nu, ORDER, nx) what they do
    to the first column of ``mean`` (n, columns); the others are its derivatives by something.
    """
    carry, mean = carry.shaped(rows, coupled), mean.shaped(n, columns)
    ahead = ahead.shaped(rows, columns)
    drive, moments = drive.shaped(nu, ORDER, nx), moments.shaped(nu, ORDER)
    by_input = {(u, j): moments[u, j] for u in range(nu) for j in range(ORDER)}
    for column in range(columns):
        before = [mean[c, column] for c in range(coupled)]
        for a in range(rows):
            total = products((carry[a, c], before[c]) for c in range(coupled))
            if a < nx and column == 0:
                total = total + products((drive[u, j, a], by_input[u, j]) for u, j in by_input)
            ahead[a, column] = total


@emitted
def predict_vectors(
    nx: int,
    nu: int,
    ny: int,
    rows: int,
    coupled: int,
    carry: Table,
    Q: Table,
    decay: Table,
    intensity: Table,
    added: Table,
    P: Table,
) -> None:
    """Carry the covariance P (n, n) over one step.

    Parameters
    ----------
    nx, nu, ny, rows, coupled : int
        States of the car, inputs, outputs; states that are carried by a full matrix (nx, and the
        filtered forces of a nonlinear car behind them); states that drive those.
    carry : (rows, coupled) table
        From the first states to the carried ones.
    Q : (nu, nx, nx) table
        Covariance for an input of unit intensity.
    decay : (n,) table
        What is left of each of the other states.
    intensity : (nu,) table
        Of the white noise of each input, m²/s³.
    added : (nu + ny,) table
        Variances that filtered noise gains, of :func:`.prediction.gained_noise`.
    """
    n = coupled + 2 * ny
    carry, Q, decay = carry.shaped(rows, coupled), Q.shaped(nu, nx, nx), decay.shaped(n)
    intensity, added = intensity.shaped(nu), added.shaped(nu + ny)
    old = new = _Symmetric(P.shaped(n, n), n)
    noises = {coupled - nu + u: u for u in range(nu)}
    noises |= {coupled + ny + y: nu + y for y in range(ny)}  # what is neither is constant
    half = {
        (a, b): products((carry[a, c], old[c, b]) for c in range(coupled))
        for a in range(rows)
        for b in range(n)
    }
    for a in range(rows):
        for b in range(a + 1):
            total = products((half[a, c], carry[b, c]) for c in range(coupled))
            if a < nx:
                total = total + products((intensity[u], Q[u, a, b]) for u in range(nu))
            new[a, b] = total
        for b in range(rows, n):
            new[b, a] = half[a, b] * decay[b] if b in noises else half[a, b]
    for a in range(rows, n):
        for b in range(rows, a + 1):
            factors = [decay[k] for k in (a, b) if k in noises]
            if not factors:
                continue
            value = old[a, b]
            for factor in factors:
                value = value * factor
            new[a, b] = value + added[noises[a]] if a == b else value


@emitted
def project_vectors(
    at: Choice,
    rows: int,
    coupled: int,
    ny: int,
    columns: int,
    C: Table,
    P: Table,
    mean: Table,
    PC: Table,
    S: Table,
    predicted: Table,
) -> None:
    """Fill P hᵀ (n,), h P hᵀ and h times the mean (n, columns) for the output ``at``, of row h."""
    n = coupled + 2 * ny
    C, P, mean, PC = C.shaped(ny, rows), P.shaped(n, n), mean.shaped(n, columns), PC.shaped(n)
    S, predicted = S.shaped(1), predicted.shaped(columns)
    for y in at.among(range(ny)):
        own = (coupled + y, coupled + ny + y)
        row = [C[y, a] for a in range(rows)]
        by = []
        for b in range(n):
            first, second = (P[max(k, b), min(k, b)] for k in own)
            total = products((row[a], P[max(a, b), min(a, b)]) for a in range(rows))
            by.append(total + (first + second))
            PC[b] = by[b]
        S[0] = products((row[a], by[a]) for a in range(rows)) + (by[own[0]] + by[own[1]])
        for column in range(columns):
            states = products((row[a], mean[a, column]) for a in range(rows))
            predicted[column] = states + (mean[own[0], column] + mean[own[1], column])


@emitted
def condition_vectors(
    n: int, columns: int, PC: Table, shift: Table, shrink: Table, mean: Table, P: Table
) -> None:
    """Update mean (n, columns) and covariance (n, n): m + P hᵀ shift, P − P hᵀ shrink h P."""
    PC, mean, P = PC.shaped(n), mean.shaped(n, columns), P.shaped(n, n)
    by, less = [PC[a] for a in range(n)], shrink.shaped(1)[0]
    gains = [shift.shaped(columns)[column] for column in range(columns)]
    for a in range(n):
        for column in range(columns):
            mean[a, column] = mean[a, column] + by[a] * gains[column]
        scaled = by[a] * less
        for b in range(a + 1):
            P[a, b] = P[a, b] - scaled * by[b]


@emitted
def rate_vectors(
    nx: int,
    ne: int,
    nu: int,
    nm: int,
    coupled: int,
    by: Table,
    B: Table,
    lag: Shared,
    inputs: Shared,
    mean: Table,
    drivers: Table,
    rate: Table,
) -> None:
    """Fill the rates of deflection before the sensors' filter (ne,), m/s.

    Parameters
    ----------
    by : (ne, coupled) table
        Their slopes, of :func:`bayes_asv.filters.suspension_forces.rate_slopes`.
    lag, inputs : (1,) and (nu,)
        1/λ, s, and the measured inputs, m/s².
    mean, drivers : (nx + ne, …) and (coupled, …) tables
        States of the car and filtered forces; biases and noise of the inputs.
    """
    rows = nx + ne + nm
    by, B, lag, inputs = by.shaped(ne, coupled), B.shaped(nx, nu), lag.shaped(1), inputs.shaped(nu)
    mean, drivers, rate = mean.shaped(rows), drivers.shaped(coupled), rate.shaped(ne)
    for e in range(ne):
        driven = products((B[2 * e + 1, u], inputs[u]) for u in range(nu))
        total = driven * lag[0] + products((by[e, b], mean[b]) for b in range(nx + ne))
        rate[e] = total + products((by[e, b], drivers[b]) for b in range(rows, coupled))


@emitted
def begin_laws_vectors(
    nx: int, ne: int, nm: int, lag: Shared, mean: Table, rate: Table, parts: Table
) -> None:
    """Fill the parts (ne, LAW_PARTS) over which force laws compose with those of a linear car.

    Parameters are those of ``_forces`` of :mod:`bayes_asv.filters.suspension_forces`.
    """
    lag, mean = lag.shaped(1), mean.shaped(nx + ne + nm)
    rate, parts = rate.shaped(ne), parts.shaped(ne, LAW_PARTS)
    for e in range(ne):
        deflection = mean[2 * e] + lag[0] * mean[2 * e + 1]
        nothing = 0.0 * deflection
        one = nothing + 1.0
        values = (deflection, rate[e], one, nothing, one, *[nothing] * 4)
        for n, value in enumerate(values):
            parts[e, n] = value


@emitted
def end_laws_vectors(
    nx: int,
    ne: int,
    ns: int,
    nm: int,
    rates: Table,
    mean: Table,
    parts: Table,
    force: Table,
    stiffness: Table,
    damping: Table,
) -> None:
    """Fill excess forces (ne,) and their slopes in deflection and rate from the parts of laws.

    The forces of dampers in series with a stiffness (ns, which is 0 or ne) and behind them those of
    friction (the others of nm) are among the states.
    """
    rates, mean, parts = rates.shaped(ne, 2), mean.shaped(nx + ne + nm), parts.shaped(ne, LAW_PARTS)
    force, stiffness, damping = force.shaped(ne), stiffness.shaped(ne), damping.shaped(ne)
    for e in range(ne):
        c, k = rates[e, 0], rates[e, 1]
        deflection, v, damper, bend, spring, curvature, *added = (
            parts[e, n] for n in range(LAW_PARTS)
        )
        linear, by_rate = c * v * (damper - 1.0), c * (damper - 1.0 + v * bend)
        if ns:
            linear, by_rate = mean[nx + ne + e] - c * v, -c
        if nm > ns:
            linear = linear + mean[nx + ne + ns + e]
        force[e] = added[0] - k * deflection * (spring - 1.0) - linear
        stiffness[e] = added[1] - k * (spring - 1.0 + deflection * curvature)
        damping[e] = added[2] - by_rate


@emitted
def begin_forces_vectors(
    nx: int, ne: int, nm: int, W: Table, force: Table, added: Shared, ahead: Table
) -> None:
    """Add what the forces at a step's beginning do if they last, to ``ahead`` (nx + ne + nm,)."""
    W, ahead = W.shaped(3, nx + ne, ne), ahead.shaped(nx + ne + nm)
    force, added = force.shaped(ne), added.shaped(ne)
    total = [force[e] + added[e] for e in range(ne)]
    for a in range(nx + ne):
        ahead[a] = ahead[a] + products((W[0, a, e], total[e]) for e in range(ne))


@emitted
def end_forces_vectors(
    nx: int,
    ne: int,
    nm: int,
    W: Table,
    bends: Shared,
    force: Table,
    last: Table,
    rate: Table,
    added: Shared,
    added_end: Shared,
    ahead: Table,
) -> None:
    """Add what the change of the forces over a step does; ``last`` (2, ne) gets its beginning."""
    W, ahead, bends = W.shaped(3, nx + ne, ne), ahead.shaped(nx + ne + nm), bends.shaped(2)
    force, last, rate = force.shaped(2, ne), last.shaped(2, ne), rate.shaped(ne)
    added, added_end = added.shaped(ne), added_end.shaped(ne)
    up, back = bends[0], bends[1]
    change = [force[1, e] - force[0, e] for e in range(ne)]
    bend = [up * change[e] - back * (force[0, e] - last[0, e]) for e in range(ne)]
    total = [change[e] + (added_end[e] - added[e]) for e in range(ne)]
    for a in range(nx + ne):
        bent = products((W[2, a, e], bend[e]) for e in range(ne))
        ahead[a] = ahead[a] + bent + products((W[1, a, e], total[e]) for e in range(ne))
    for e in range(ne):
        last[0, e], last[1, e] = force[0, e], rate[e]


def _force_slopes(
    e: int, damping: Vector, stiffness: Vector, delay: Vector, by: Table, own: list[int]
) -> dict[int, Vector]:
    """Slopes of an excess force in the states, but −1 in forces that are states themselves."""
    out = {b: damping * by[e, b] for b in own}
    out[2 * e] = out[2 * e] + stiffness
    out[2 * e + 1] = out[2 * e + 1] + delay * stiffness
    return out


@emitted
def linearise_vectors(
    nx: int,
    ne: int,
    nm: int,
    coupled: int,
    base: Table,
    W: Table,
    lag: Shared,
    by: Table,
    stiffness: Table,
    damping: Table,
    series: Table,
    carry: Table,
) -> None:
    """Fill the Jacobian of a step with forces that change along it.

    They change in a straight line: the bend of their path depends on the states before the step
    as well, and vanishes where those lead to it in a straight line.

    Parameters
    ----------
    base, carry : (rows, coupled) tables
        Jacobian of the linear car and of the filtered forces, in its first nx + ne rows, and the
        one that is wanted.
    W, lag : (3, nx + ne, ne) and (1,)
        Weights of the forces, and 1/λ, s.
    by, stiffness, damping, series : (ne, coupled), (2, ne), (2, ne) and (4, nm) tables
        As :func:`bayes_asv.filters.suspension_forces.advance_forces` leaves them.
    """
    nf, rows = nx + ne, nx + ne + nm
    base, carry, by = (
        base.shaped(rows, coupled),
        carry.shaped(rows, coupled),
        by.shaped(ne, coupled),
    )
    W, lag = W.shaped(3, nf, ne), lag.shaped(1)
    stiffness, damping = stiffness.shaped(2, ne), damping.shaped(2, ne)
    series = series.shaped(4, nm)
    delay = lag[0]
    own = [*range(nf), *range(rows, coupled)]  # what rates depend on

    def slopes(end: int, e: int) -> dict[int, Vector]:
        return _force_slopes(e, damping[end, e], stiffness[end, e], delay, by, own)

    first = [slopes(0, e) for e in range(ne)]
    early = {}
    for a in range(nf):
        for b in range(coupled):
            pairs = ((W[0, a, e], first[e][b]) for e in range(ne) if b in first[e])
            total = plus(base[a, b], pairs)
            early[a, b] = total - W[0, a, (b - nf) % ne] if nf <= b < rows else total
    for m in range(nm):
        e = m % ne
        for b in range(coupled):
            total = products((by[e, a], early[a, b]) for a in range(nf))
            total = (total + by[e, b] if b >= rows else total) * series[2, m]
            if b in own:
                total = total + series[1, m] * by[e, b]
            early[nf + m, b] = total + series[0, m] if b == nf + m else total
            carry[nf + m, b] = early[nf + m, b]
    for b in range(coupled):
        change = []
        for e in range(ne):
            last = slopes(1, e)
            total = products((last[a], early[a, b]) for a in range(nf))
            for m in range(e, nm, ne):
                total = total - early[nf + m, b]
            if b >= rows:
                total = total + last[b]
            if b in first[e]:
                total = total - first[e][b]
            change.append(total)
        for a in range(nf):
            total = plus(early[a, b], ((W[1, a, e], change[e]) for e in range(ne)))
            carry[a, b] = total + W[1, a, (b - nf) % ne] if nf <= b < rows else total


@emitted
def feedback_vectors(
    nx: int,
    ne: int,
    nm: int,
    coupled: int,
    W: Table,
    lag: Shared,
    by: Table,
    stiffness: Table,
    damping: Table,
    series: Table,
    feedback: Table,
) -> None:
    """Fill what the suspension forces at the end of a step make of a change within it.

    ``feedback`` (rows, nx + ne) gets the slopes of the states after the step in car and filtered
    forces as they are without that change of the forces; the others are those of
    :func:`linearise_vectors`.
    """
    nf, rows = nx + ne, nx + ne + nm
    by, feedback, series = by.shaped(ne, coupled), feedback.shaped(rows, nf), series.shaped(4, nm)
    W, lag = W.shaped(3, nf, ne), lag.shaped(1)
    stiffness, damping = stiffness.shaped(2, ne), damping.shaped(2, ne)
    last = [
        _force_slopes(e, damping[1, e], stiffness[1, e], lag[0], by, [*range(nf)])
        for e in range(ne)
    ]
    for b in range(nf):
        change = [last[e][b] for e in range(ne)]
        for m in range(nm):
            at_end = by[m % ne, b] * series[2, m]
            feedback[nf + m, b] = at_end
            change[m % ne] = change[m % ne] - at_end
        for a in range(nf):
            total = products((W[1, a, e], change[e]) for e in range(ne))
            feedback[a, b] = total + 1.0 if a == b else total
