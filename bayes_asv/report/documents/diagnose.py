"""Document of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.diagnosis.engine import Engine
from bayes_asv.diagnosis.localization import Cell
from bayes_asv.diagnosis.residual_tests import Outlier
from bayes_asv.diagnosis.simulation_error import ErrorChange
from bayes_asv.diagnosis.unlisted_fault_models import UnnamedCause
from bayes_asv.diagnosis.workflow import DiagnosisResult, NamedEffect
from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.report.documents.force_curves import force_curves
from bayes_asv.report.documents.quantities import (
    Units,
    damper_rates,
    effect_value,
    parameter,
    spring_curve,
    without_single_rate,
)
from bayes_asv.report.schema import DiagnoseDocument
from bayes_asv.report.schema import diagnose as schema
from bayes_asv.report.schema.parts import (
    EffectName,
    EffectValue,
    Parameter,
    Provenance,
    SourceFile,
    VehicleInfo,
)

__all__ = ["diagnose_document", "nominal_quantities"]

Array = NDArray[np.float64]

_MAX_POINTS: Final = 1200  # of a curve
_SHOWN: Final = 1.0  # s of a run
_ALONG: Final = {
    ("force", "velocity"): "damper velocity",
    ("force", "acceleration"): "acceleration of the body",
}


def diagnose_document(
    diagnosis: DiagnosisResult, recordings: Sequence[Recording] = ()
) -> DiagnoseDocument:
    """Document of a diagnosis.

    Parameters
    ----------
    diagnosis : DiagnosisResult
        From :func:`bayes_asv.diagnosis.workflow.diagnose`.
    recordings : sequence of Recording
        The fitted and the held-out recordings, for the provenance.
    """
    vehicle = diagnosis.vehicle
    other: dict[str, str] = {} if diagnosis.car == "half" else {"car": diagnosis.car}
    return DiagnoseDocument(
        **other,
        schema="bayes_asv/diagnose/1",
        verdict=diagnosis.verdict,
        reasons=list(diagnosis.reasons),
        warnings=[_without_folders(text, recordings) for text in diagnosis.warnings],
        preflight=[schema.RecordingFault.model_validate(f) for f in diagnosis.recording_faults],
        effects=_effects(diagnosis),
        unexplained=_unexplained(diagnosis),
        unnamed=[_unnamed(cause, diagnosis) for cause in diagnosis.unnamed],
        disagreement=_disagreement(diagnosis),
        gap=_gap(diagnosis.errors or {}, vehicle),
        parameters_before=_parameters(diagnosis.quantities_before, diagnosis),
        parameters_after=_parameters(diagnosis.quantities_after, diagnosis),
        p_value=diagnosis.p_value,
        p_none=diagnosis.p_none,
        map=None
        if diagnosis.localization is None
        else {
            axle: [_cell(cell, vehicle) for cell in cells]
            for axle, cells in diagnosis.localization.force_maps.items()
        },
        laws=force_curves(diagnosis),
        dampers=[damper_rates(one, Units(vehicle.units)) for one in diagnosis.dampers],
        springs=[
            spring_curve(
                one,
                float(diagnosis.final_model.space.car.nominal[one.parameter][0]),
                Units(vehicle.units),
            )
            for one in diagnosis.springs
            if diagnosis.final_model is not None
        ],
        residuals=_residuals(diagnosis),
        runs=schema.FittedRuns(
            fit=[prepared.source for prepared in diagnosis.fitted],
            holdout=[prepared.source for prepared in diagnosis.holdout],
        ),
        vehicle=VehicleInfo(name=vehicle.name, units=vehicle.units),
        provenance=Provenance(
            recordings=[
                SourceFile(file=Path(r.source).name, sha256=r.sha256) for r in recordings
            ],
            vehicle=SourceFile(file=Path(vehicle.source).name, sha256=vehicle.sha256),
        ),
        seconds=diagnosis.seconds,
        version=__version__,
        seed=diagnosis.seed,
    )  # fmt: skip


def _without_folders(text: str, recordings: Sequence[Recording]) -> str:
    """Name recordings without their folders, which are private."""
    for recording in recordings:
        text = text.replace(recording.source, Path(recording.source).name)
    return text


def _effects(diagnosis: DiagnosisResult) -> list[schema.NamedEffect]:
    engine = [] if diagnosis.engine is None else [_engine(diagnosis.engine, diagnosis)]
    return engine + [_effect(named, diagnosis) for named in diagnosis.named]


def _engine(engine: Engine, diagnosis: DiagnosisResult) -> schema.NamedEffect:
    units = Units(diagnosis.vehicle.units)
    frequency = [float(v) for v in engine.frequency]
    amplitude = [units.convert(float(v), "force") for v in engine.amplitude]
    return schema.NamedEffect(
        name="engine_vibration",
        where=None,
        title="an engine that shakes the frame",
        probability=diagnosis.probability_of(engine),
        indistinguishable_from=[],
        drive="the same drive with the engine off",
        parameters={
            name: EffectValue(mean=mean, eti95=[low, high], unit=unit)
            for name, (mean, low, high), unit in (
                ("frequency", frequency, "Hz"), ("amplitude", amplitude, units.unit("force")),
            )
        },
        gap=schema.Gap() if diagnosis.named else _gap(diagnosis.errors or {}, diagnosis.vehicle),
        tones=[float(tone) for tone in engine.tones],
    )  # fmt: skip


def _effect(named: NamedEffect, diagnosis: DiagnosisResult) -> schema.NamedEffect:
    placed = named.placed
    draws = (diagnosis.effect_draws or {}).get(str(placed), {})
    others = [
        EffectName(
            name=o.placed.effect.name, where=o.placed.where or None, title=o.placed.effect.title
        )
        for o in named.indistinguishable
    ]
    # A wrong mass scales both springs and has no signature of its own.
    springs = {n.placed.where for n in diagnosis.named if n.placed.effect.name == "spring_rate"}
    if placed.effect.name == "spring_rate" and springs == {"front", "rear"}:
        others.append(EffectName(name="mass_scale", where=None, title="a wrong mass"))
    return schema.NamedEffect(
        name=placed.effect.name,
        where=placed.where or None,
        title=placed.effect.title,
        probability=diagnosis.probability_of(named),
        indistinguishable_from=others,
        drive=placed.effect.drive,
        parameters={
            p.name: effect_value(p, draws[p.name], placed, diagnosis.vehicle)
            for p in placed.effect.parameters
            if p.name in draws
        },
        gap=_gap(named.errors, diagnosis.vehicle),
        run=None if placed.run is None else diagnosis.fitted[placed.run].source,
    )


def _gap(gaps: Mapping[str, ErrorChange], vehicle: Vehicle) -> schema.Gap:
    units = Units(vehicle.units)
    dimension = next((gap.dimension for gap in gaps.values()), "acceleration")
    # outputs of several quantities are compared relative to the deviation of their readings
    relative = dimension == "dimensionless"
    factor = 100.0 if relative else units.convert(1.0, dimension)

    def error(name: str) -> schema.SimulationError | None:
        if name not in gaps:
            return None
        gap = gaps[name]
        return schema.SimulationError(
            before=factor * gap.before,
            after=factor * gap.after,
            floor=factor * gap.floor,
            closed=gap.closed,
            worse=bool(gap.worse),
        )

    unit = "%" if relative else units.unit(dimension)
    return schema.Gap(fit=error("fit"), holdout=error("holdout"), unit=unit)


def _unexplained(diagnosis: DiagnosisResult) -> schema.Unexplained:
    left = diagnosis.unexplained
    if left is None:
        return schema.Unexplained(present=False, score=None)
    return schema.Unexplained(
        present=bool(left.present),
        score=left.score,
        axle=left.axle,
        p_memory=left.p_whiteness,
        swollen=list(left.excess_noise),
        p_decoy=left.p_unlisted,
        like=left.closest_fault,
        failed=list(left.failed),
        ended=left.stopped_by,
        p_jitter=left.p_jitter,
        jitters=left.jitter_channel,
        missing_bits=list(left.missing_bits),
        outlier=_outlier(left.outlier) if left.outlier.readings else None,
        rival=left.alternative,
    )


def _outlier(outlier: Outlier) -> schema.Outlier:
    return schema.Outlier(
        p=outlier.p,
        channel=outlier.channel,
        source=Path(outlier.source).name,
        time=outlier.time,
        readings=outlier.readings,
    )


def _unnamed(cause: UnnamedCause, diagnosis: DiagnosisResult) -> schema.UnnamedCause:
    """Draw a cause without a name for a while of the run in which it changes most."""
    units = Units(diagnosis.vehicle.units)
    power = [float(np.mean(change**2)) for change in cause.changes]
    run = int(np.argmax(power))
    prepared = diagnosis.fitted[run]
    time, change = prepared.instants, cause.changes[run]
    count = max(int(np.searchsorted(time, time[0] + _SHOWN)), 2)
    energy = np.convolve(change**2, np.ones(min(count, len(change))), "valid")
    begin = int(np.argmax(energy))
    shown = np.arange(begin, min(begin + count, len(time)))
    shown = shown[:: max(1, math.ceil(len(shown) / _MAX_POINTS))]
    of_change, of_along = cause.dimensions
    return schema.UnnamedCause(
        like=f"{cause.kind} {cause.place}",
        share=cause.share,
        source=prepared.source,
        time=units.curve(time[shown]),
        change=units.curve(change[shown], of_change),
        unit=units.unit(of_change),
        along=units.curve(cause.along[run][shown], of_along),
        along_unit=units.unit(of_along),
        along_words=_ALONG.get(cause.dimensions, "reading"),
    )


def _disagreement(diagnosis: DiagnosisResult) -> schema.Disagreement | None:
    seen = diagnosis.localization
    if seen is None:
        return None
    return schema.Disagreement(
        channel=seen.channel,
        axle=seen.axle or None,
        time=[[float(a), float(b)] for _, a, b in seen.windows],
        time_run=[diagnosis.fitted[run].source for run, _, _ in seen.windows],
        frequency=[[float(a), float(b)] for a, b in seen.bands],
        state=None if seen.strongest is None else _cell(seen.strongest, diagnosis.vehicle),
    )


def _cell(cell: Cell, vehicle: Vehicle) -> schema.Cell:
    units = Units(vehicle.units)
    return schema.Cell(
        deflection=[units.convert(float(v), "length") for v in cell.deflection],
        velocity=[units.convert(float(v), "velocity") for v in cell.velocity],
        force=units.convert(float(cell.force), "force"),
        t=float(cell.t),
        units=[units.unit(dimension) for dimension in ("length", "velocity", "force")],
    )


def nominal_quantities(diagnosis: DiagnosisResult) -> dict[str, float]:
    """Nominal values of the parameters that are asked for and of what is derived, SI units."""
    car = car_model(diagnosis.car, diagnosis.vehicle)
    derived = {} if car.derived is None else car.derived(car.nominal)
    asked = {name: car.nominal[name] for name in car.estimated}
    return {name: float(value[0]) for name, value in (asked | derived).items()}


def _parameters(draws: dict[str, Array] | None, diagnosis: DiagnosisResult) -> dict[str, Parameter]:
    free_form = without_single_rate(diagnosis.dampers)
    return {
        name: parameter(name, draws[name], diagnosis.vehicle, nominal).model_copy(
            update={"withheld": name in free_form}
        )
        for name, nominal in nominal_quantities(diagnosis).items()
        if draws and name in draws
    }


def _residuals(diagnosis: DiagnosisResult) -> list[schema.Residual]:
    """Measured less simulated readings of every fitted run, before and after.

    The simulation is driven by the wheels alone.  An engine's tones are removed from both.
    """
    if diagnosis.base_model is None or diagnosis.final_model is None:
        return []
    units, entries = Units(diagnosis.vehicle.units), []
    for run, prepared in enumerate(diagnosis.base_model.space.recordings):
        residuals = []
        for model in (diagnosis.base_model, diagnosis.final_model):
            own = model.space.recordings[run]
            output, _, _ = free_run(model.posterior, model.mode.z, run)
            residuals.append(own.paired(np.where(own.kind == VALUE, own.reading - output, np.nan)))
        time = prepared.instants[prepared.group_instants.max(axis=1)]
        keep = np.unique(np.linspace(0, len(time) - 1, _MAX_POINTS).astype(int))
        outputs = [prepared.channels[c] for c in prepared.outputs]
        curves = {
            channel.name: _before_after(
                [units.curve(residual[keep, y], channel.dimension) for residual in residuals],
                units.unit(channel.dimension),
                units.unit("acceleration"),
            )
            for y, channel in enumerate(outputs)
        }
        entries.append(
            schema.Residual(
                source=prepared.source,
                unit=units.unit("acceleration"),
                time=units.curve(time[keep]),
                seconds=[float(time[0]), float(time[-1])],
                spectrum=_spectrum(residuals, outputs, prepared.reading_step, units),
                **curves,
            )
        )
    return entries


def _before_after(
    curves: Sequence[list[float | None]], unit: str, usual: str
) -> schema.BeforeAfter:
    """Return curves before and after, with their unit where it is not the usual one."""
    before, after = curves
    if unit == usual:
        return schema.BeforeAfter(before=before, after=after)
    return schema.BeforeAfter(unit=unit, before=before, after=after)


def _spectrum(
    residuals: Sequence[Array], outputs: Sequence[Channel], step: float, units: Units
) -> schema.ResidualSpectrum:
    from scipy.signal import welch

    length = min(256, len(residuals[0]))
    frequency = np.asarray(np.fft.rfftfreq(length, step), dtype=float)
    usual = _density_unit(units.unit("acceleration"))
    curves = {}
    for y, channel in enumerate(outputs):
        factor = units.convert(1.0, channel.dimension) ** 2
        spectra = [
            welch(np.nan_to_num(residual[:, y]), 1.0 / step, nperseg=length)[1][1:]
            for residual in residuals
        ]
        curves[channel.name] = _before_after(
            [units.curve(factor * spectrum) for spectrum in spectra],
            _density_unit(units.unit(channel.dimension)),
            usual,
        )
    return schema.ResidualSpectrum(unit=usual, frequency=units.curve(frequency[1:]), **curves)


def _density_unit(unit: str) -> str:
    return f"({unit})^2/Hz"
