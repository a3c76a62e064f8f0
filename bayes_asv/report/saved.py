"""Reading a saved document: what comes from a file is checked before anything is told from it.

A document may be cut off, come from another program or be made to do harm. What the report
counts on is checked here by shape, size and sense; further keys are left alone, so that newer
documents stay readable.
"""

from __future__ import annotations

import json
import os
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from bayes_asv.errors import InputError
from bayes_asv.files import PathLike, decode, read_bytes

__all__ = ["read_saved"]

_SCHEMA: Final = "bayes_asv/estimate/1"
_MEND: Final = "give a file that 'bayes-asv estimate --json' wrote"
_LARGEST_FILE: Final = 200_000_000
_MOST_POINTS: Final = 100_000
_LARGEST: Final = 1e15
_SMALLEST: Final = 1e-30

Finite = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)]
Size = Annotated[float, Field(ge=0.0, le=_LARGEST, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Words = Annotated[str, Field(max_length=10_000)]
Unit = Annotated[str, Field(max_length=64)]
Count = Annotated[int, Field(ge=0, le=10**12)]
Curve = Annotated[list[Finite | None], Field(max_length=_MOST_POINTS)]
Sentences = Annotated[list[Words], Field(max_length=1000)]
Pair = Annotated[list[Finite], Field(min_length=2, max_length=2)]
Band = Annotated[list[Curve], Field(min_length=2, max_length=2)]
Axle = Literal["front", "rear"]
Channel = Literal["front_wheel", "front_chassis", "rear_wheel", "rear_chassis"]
Chassis = Literal["front_chassis", "rear_chassis"]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow")


class _Summary(_Part):
    mean: Finite
    median: Finite | None = None
    sd: Size
    eti95: Pair

    @model_validator(mode="after")
    def _ordered(self) -> _Summary:
        low, high = self.eti95
        if low > high:
            raise ValueError("the interval ends before it begins")
        return self


class _Shown(_Summary):
    unit: Unit
    nominal: Finite | None = None


class _Parameter(_Shown):
    label: Words = ""
    p_below_nominal: Share | None = None
    si: _Shown | None = None


class _Known(_Part):
    label: Words = ""
    unit: Unit
    value: Finite
    sd: Size | None = None
    posterior: _Summary | None = None


class _Prior(_Part):
    median: Positive
    log_sd: Annotated[float, Field(ge=1e-9, le=50.0, allow_inf_nan=False)]


class _Diagnostics(_Part):
    rhat_max: Finite | None = None
    ess_bulk_min: Finite | None = None
    ess_tail_min: Finite | None = None
    acceptance: Finite | None = None
    draws: Count | None = None
    likelihood: Words = ""


class _Fit(_Part):
    nrmse_percent: Size


class _Fits(_Part):
    source: Words = ""
    front_chassis: _Fit | None = None
    rear_chassis: _Fit | None = None


class _NoiseOf(_Summary):
    given: Size | None = None


class _Noise(_Part):
    source: Words
    unit: Unit
    front_wheel: _NoiseOf | None = None
    front_chassis: _NoiseOf | None = None
    rear_wheel: _NoiseOf | None = None
    rear_chassis: _NoiseOf | None = None


class _Spectrum(_Part):
    unit: Unit = ""
    frequency: Curve
    measured: Curve
    residual: Curve

    @model_validator(mode="after")
    def _long(self) -> _Spectrum:
        _alike(len(self.frequency), self.measured, self.residual)
        return self


class _Chassis(_Part):
    measured: Curve
    simulated: Curve
    band95: Band
    autocorrelation: Annotated[list[Finite | None], Field(max_length=1000)] = []
    autocorrelation_band95: Size = 0.0
    whiteness_p: Share | None = None
    lag_seconds: Size = 0.0
    spectrum: _Spectrum | None = None


class _TravelOf(_Part):
    deflection: Curve
    velocity: Curve
    band95: Band
    largest_bump: Size
    largest_droop: Size


class _Travel(_Part):
    unit: Unit
    velocity_unit: Unit = ""
    front: _TravelOf | None = None
    rear: _TravelOf | None = None


class _Wheels(_Part):
    time: Curve
    front_wheel: Curve
    rear_wheel: Curve

    @model_validator(mode="after")
    def _long(self) -> _Wheels:
        _alike(len(self.time), self.front_wheel, self.rear_wheel)
        return self


class _Run(_Part):
    source: Words
    unit: Unit
    rate: Annotated[float, Field(ge=1e-3, le=1e8, allow_inf_nan=False)]
    seconds: Size
    time: Curve
    chassis: dict[Chassis, _Chassis]
    wheels: _Wheels
    travel: _Travel

    @model_validator(mode="after")
    def _long(self) -> _Run:
        n = len(self.time)
        for part in self.chassis.values():
            _alike(n, part.measured, part.simulated, *part.band95)
        for side in (self.travel.front, self.travel.rear):
            if side is not None:
                _alike(n, side.deflection, side.velocity, *side.band95)
        return self


class _Stops(_Part):
    unit: Unit = ""
    front_bump: Positive | None = None
    front_droop: Positive | None = None
    rear_bump: Positive | None = None
    rear_droop: Positive | None = None


class _Vehicle(_Part):
    name: Words = ""
    units: Literal["US", "SI"] = "SI"
    source: Words = ""
    sha256: Words = ""
    travel: _Stops | None = None


class _File(_Part):
    file: Words = ""
    sha256: Words = ""


class _Provenance(_Part):
    recordings: Annotated[list[_File], Field(max_length=1000)] = []
    vehicle: _File | None = None
    python: Words = ""
    packages: dict[Words, Words] = {}


class _Document(_Part):
    verdict: Literal["ok", "not_converged", "refused"]
    reasons: Sentences
    warnings: Sentences
    parameters: dict[
        Literal["c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r", "m", "l", "wdf", "k_f", "k_r"],
        _Parameter,
    ]
    diagnostics: _Diagnostics
    fit: _Fits
    known: dict[Words, _Known] = {}
    prior: dict[Words, _Prior] = {}
    fit_by_run: Annotated[list[_Fits], Field(max_length=1000)] = []
    noise: Annotated[list[_Noise], Field(max_length=1000)] = []
    runs: Annotated[list[_Run], Field(max_length=1000)] = []
    draws: dict[Words, Curve] = {}
    vehicle: _Vehicle = _Vehicle()
    provenance: _Provenance = _Provenance()
    version: Words
    seed: Count

    @model_validator(mode="after")
    def _sense(self) -> _Document:
        if self.verdict == "refused" and not self.reasons:
            raise ValueError("it is refused without a reason")
        if self.verdict != "refused":
            missing = [n for n in ("c_f", "c_r", "i", "k_g") if n not in self.parameters]
            if missing:
                raise ValueError(f"it has a verdict but no parameter {missing[0]}")
        _alike(None, *self.draws.values())
        return self


def read_saved(path: PathLike) -> dict[str, Any]:
    """Read a document that ``bayes-asv estimate --json`` wrote.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    dict
        Schema ``bayes_asv/estimate/1``, as plain data.

    Raises
    ------
    InputError
        One line with the file, the key and the mend: unreadable, cut off, of another schema, or
        holding what no estimate holds.
    """
    where = os.fspath(path)
    text = decode(read_bytes(path, _LARGEST_FILE), where)
    try:
        document = json.loads(text, parse_constant=_no_constant)
    except json.JSONDecodeError as fault:
        end = "" if text.rstrip().endswith("}") else " (it may be cut off)"
        raise InputError(f"{where}:{fault.lineno}", f"is not JSON{end}", _MEND) from None
    except (ValueError, RecursionError):
        raise InputError(where, "is not JSON", _MEND) from None
    said = document.get("schema") if isinstance(document, dict) else None
    if said != _SCHEMA:
        what = f"is of schema {str(said)[:60]!r}, not {_SCHEMA}" if said else "is no estimate"
        raise InputError(where, what, _MEND)
    try:
        _Document.model_validate(document)
    except ValidationError as fault:
        first = fault.errors(include_url=False, include_input=False, include_context=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        what = first["msg"].removeprefix("Value error, ")
        what = what[:1].lower() + what[1:]
        raise InputError(f"{where}: {key}" if key else where, what, _MEND) from None
    assert isinstance(document, dict)
    return document


def _no_constant(name: str) -> float:
    raise ValueError(name)  # NaN and Infinity are not JSON


def _alike(count: int | None, *curves: list[float | None]) -> None:
    wanted = len(curves[0]) if count is None and curves else count
    if any(len(curve) != wanted for curve in curves):
        raise ValueError("curves of one figure differ in length")
