"""``asv.track``: the parameters row by row, as an online filter knows them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, write_atomically
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.library.estimates import car_of, check_seed, read_effects
from bayes_asv.library.extras import import_extra
from bayes_asv.library.inputs import check_inputs
from bayes_asv.library.parameter import from_log_normal
from bayes_asv.library.progress import Progress, progress_bar
from bayes_asv.library.result import Result

if TYPE_CHECKING:
    import pandas as pd

    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.library.plots import TrackPlots
    from bayes_asv.report.documents.track import Trace
    from bayes_asv.report.schema import TrackDocument
    from bayes_asv.tracking.track import TrackResult

__all__ = ["Track", "track", "track_of"]


class Track(Result):
    """A recording tracked to its end, from :func:`bayes_asv.track`.

    ``verdict`` is ``"ok"`` or ``"refused"``.  ``result["c_f"]`` and the other parameters are those
    after the last row; :meth:`trace` has those after each row.  Where ``consistency`` is
    ``"inconsistent"`` the intervals are not to be relied on.
    """

    document: TrackDocument

    def __init__(
        self,
        engine: TrackResult,
        document: TrackDocument,
        parameters: dict[str, Any],
        rows: Trace | None = None,
    ):
        super().__init__(document, parameters, engine.vehicle)
        self._engine = engine
        self._rows = rows

    @property
    def effects(self) -> list[Any]:
        """Effects in the model, with their parameters after the last row."""
        return list(self.document.effects)

    @property
    def consistency(self) -> str:
        """``"consistent"``, ``"recovered"`` or ``"inconsistent"``."""
        return str(self.document.consistency.verdict)

    @cached_property
    def plot(self) -> TrackPlots:
        """Figures: ``plot.parameters()``, ``plot.consistency()``."""
        from bayes_asv.library.plots import TrackPlots

        return TrackPlots(self.document)

    def trace(self, units: Literal["vehicle", "SI", "US"] = "vehicle") -> pd.DataFrame:
        """Return the parameters after each row as a table.

        Parameters
        ----------
        units : {'vehicle', 'SI', 'US'}
            System of units; by default that of the vehicle file.

        Returns
        -------
        pandas.DataFrame
            Index ``time [s]``; the parameters of interest, such as ``c_f``, ``c_r`` and ``i``
            (medians), with ``c_f_lb``, ``c_f_ub`` and so on (95 %), ``nis_mean`` and
            ``consistent``.
        """
        pandas = import_extra("pandas", "trace()")
        frames = self._engine.frames
        shown = display_units(self.vehicle.units if units == "vehicle" else units)
        table: dict[str, Any] = {}
        for k, name in enumerate(self._engine.coordinates.estimands):
            dimension = QUANTITIES[name][0]
            median = frames.median[:, k] * from_si(1.0, shown[dimension], dimension)
            spread = np.exp(NORMAL_975 * frames.log_sd[:, k])
            table |= {name: median, f"{name}_lb": median / spread, f"{name}_ub": median * spread}
        table |= {"nis_mean": frames.nis_mean, "consistent": frames.consistent}
        return pandas.DataFrame(table, index=pandas.Index(frames.time, name="time [s]"))

    def write_trace(self, path: PathLike) -> None:
        """Write the state after each row as CSV, in the vehicle's units.

        Parameters
        ----------
        path : str or os.PathLike
            The file.
        """
        from bayes_asv.report.documents.track import Trace

        rows = self._rows
        if rows is None:
            rows = Trace(self.vehicle, self._engine.coordinates)
            rows.append(self._engine.frames)
        try:
            write_atomically(path, rows.pieces())
        finally:
            if rows is not self._rows:
                rows.close()
        self.document.trace = str(path)

    def lines(self) -> list[str]:
        """State the result in sentences, as the command line prints them."""
        from bayes_asv.report.sections.verdict import track_lines

        return track_lines(self.document)


def track(
    recordings: Recording | Iterable[Recording],
    vehicle: Vehicle,
    *,
    car: str | None = None,
    effects: str | Sequence[str] = (),
    forget: float | None = None,
    engine: Literal["compiled", "filterpy"] = "compiled",
    seed: int = 0,
    progress: Progress = None,
) -> Track:
    """Track damping rates and inertias through one recording, row by row.

    Parameters
    ----------
    recordings : Recording or iterable of Recording
        One recording.
    vehicle : Vehicle
        The car.
    car : {'half', 'quarter-front', 'quarter-rear', 'roll'}, optional
        Model of the car; by default that whose wheels the recording has.
    effects : str or sequence of str, optional
        Effects that the car or its sensors have, such as ``"bound_rebound@rear"``
        (``docs/effects.md``).
    forget : float, optional
        Let the parameters change by 10 % (one standard deviation) in this time, s; constant
        without it.
    engine : {'compiled', 'filterpy'}
        The fast implementation of the filter, or the readable one; both give the same.
    seed : int
        Recorded in the document; the filter draws nothing.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`.

    Returns
    -------
    Track

    Raises
    ------
    TypeError, InputError
        As :func:`bayes_asv.estimate`.
    """
    check_seed(seed)
    name = car or car_of(recordings)
    runs, given = check_inputs("track", recordings, vehicle, car=name)
    if len(runs) > 1:
        raise InputError("track", f"{len(runs)} recordings were given", "track one after the other")
    from bayes_asv.tracking import track as engine_track

    placed_effects = read_effects(effects)
    with progress_bar(progress) as report:
        result = engine_track.track(
            runs[0],
            given,
            car=name,
            effects=placed_effects,
            forget=forget,
            engine=engine,
            progress=report,
        )
    return track_of(result, seed)


def track_of(result: TrackResult, seed: int = 0, rows: Trace | None = None) -> Track:
    """Wrap what the online filter found; `rows` holds the trace of a drive too long to keep."""
    from bayes_asv.report.documents.track import track_document

    document = track_document(result, seed=seed)
    parameters = {}
    for name, p in document.parameters.items():
        assert p.si is not None
        assert p.si.median is not None
        assert p.si.nominal is not None
        log_sd = math.log(p.si.eti95[1] / p.si.eti95[0]) / (2.0 * NORMAL_975)
        parameters[name] = from_log_normal(
            name, p.si.median, log_sd, p.si.nominal, result.vehicle.units,
            result.probability_below_nominal(name),
        )  # fmt: skip
    return Track(result, document, parameters, rows)
