"""Effects beside the linear car: sentences, tables, and force curves of damper and spring."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from bayes_asv.report import svg
from bayes_asv.report.schema import DiagnoseDocument, EstimateDocument
from bayes_asv.report.schema.diagnose import ForceCurve, NamedEffect
from bayes_asv.report.schema.estimate import ClockErrors
from bayes_asv.report.schema.parts import (
    DamperShape,
    DampingRates,
    Effect,
    EffectName,
    EffectValue,
    SpringCurve,
    SpringShape,
    Summary,
)
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table
from bayes_asv.report.sections.damper_force import draw_force_curve, label_sides
from bayes_asv.report.words import (
    MISSING,
    capitalized,
    enumerated,
    number,
    plain,
    probability,
    readable_unit,
    two_digits,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "MODEL_SECTION",
    "SECTION",
    "car_words",
    "clock_lines",
    "damper_lines",
    "effect_lines",
    "effect_name",
    "effect_sentence",
    "rate_lines",
    "spring_lines",
    "value_text",
]


class _Sentence(NamedTuple):
    part: str
    """The part at fault; ``{}`` is its place."""
    statement: str
    """What it does; each parameter of the effect is in braces."""


_SENTENCES: Final = {
    "bound_rebound": _Sentence("{} damper", "rebound damping is {ratio} times compression damping"),
    "digressive_damper": _Sentence("{} damper", "its force rises less above {knee}"),
    "damper_curve": _Sentence("{} damper", "its force is not proportional to speed"),
    "damper_hysteresis": _Sentence(
        "{} damper", "its force lags velocity, in series with a stiffness of {stiffness}"
    ),
    "damper_fade": _Sentence("{} damper", "it loses {loss} of its damping during the run"),
    "coulomb_friction": _Sentence("{} suspension", "dry friction of {force}"),
    "spring_curve": _Sentence("{} spring", "its force is not proportional to travel"),
    "progressive_spring": _Sentence("{} spring", "it stiffens with travel, kappa {kappa}"),
    "spring_rate": _Sentence("{} spring", "its rate is {factor} times the given value"),
    "bump_stop": _Sentence("{} bump stop", "met at {gap} from rest, with a rate of {rate}"),
    "droop_stop": _Sentence("{} droop stop", "met at {gap} from rest, with a rate of {rate}"),
    "weight_distribution": _Sentence(
        "Weight distribution", "the front weight fraction is {factor} times the given value"
    ),
    "external_force": _Sentence(
        "{} axle", "an external force of {force} from {start} on, for {duration}"
    ),
    "sensor_gain": _Sentence("{} sensor", "it reads {factor} times the true value"),
    "sensor_lag": _Sentence("{} sensor", "it samples {lag} later than declared"),
    "clock_offset": _Sentence("{} channels", "they are sampled {offset} later than the others"),
    "sensor_bandwidth": _Sentence("{} sensor", "its bandwidth is {bandwidth}, not as declared"),
    "sensor_drift": _Sentence("{} sensor", "its zero drifts by {slope}"),
    "engine_vibration": _Sentence("Engine", "vibration at {frequency} with a force of {amplitude}"),
}
_NAMES: Final = {"bound_rebound": "unequal compression and rebound damping"}
_PROBABLE, _POSSIBLE = 0.95, 0.7  # probabilities below which a finding is qualified

_FORCES: Final = (
    "The linear {car} lacked the difference between the coloured and the grey curve. Bands are "
    "95 %, over the range that the fitted runs covered. Compression is a negative velocity, bump a "
    "negative deflection; a force that resists extension is positive."
)


_SPRING_FORCES: Final = (
    "The band is the 95 % band, over the range that the recordings covered. Bump is a negative "
    "deflection; a force that resists extension is positive."
)


def _content(document: DiagnoseDocument) -> Iterator[Block]:
    if document.effects:
        yield _effect_table(document.effects)
    caption = _FORCES.format(car=car_words(document))
    yield Figure("laws", "Force of damper and spring", caption, _force_curves(document))


def _model_content(document: EstimateDocument) -> Iterator[Block]:
    if document.effects:
        yield _model_table(document.effects)
    if document.dampers:
        yield _damper_table(document.dampers)
    if document.springs:
        yield _spring_table(document.springs)
        panels = tuple(_spring_panel(spring) for spring in document.springs)
        yield Figure("springs", "Force of the spring", _SPRING_FORCES, panels)


def _model_limits(document: EstimateDocument) -> list[str]:
    """Name the effects that a diagnosis of the same recordings found and the model lacks."""
    diagnosis = document.diagnosis
    if diagnosis is None or diagnosis.verdict not in ("named", "unexplained"):
        return []
    model = {(effect.name, effect.where) for effect in document.effects}
    names = [effect_name(e) for e in diagnosis.effects if (e.name, e.where) not in model]
    if not names and diagnosis.effects:
        return []
    missing = enumerated(names) if names else "something that no listed effect explains"
    return [
        f"The model of this estimate is a {'' if document.effects else 'linear '}"
        f"{car_words(document)}, but the recordings show {missing}. The parameters with it are "
        "under 'What is missing?'."
    ]


SECTION: Final = Section(_content)
"""Effects that a diagnosis named."""

MODEL_SECTION: Final = Section(_model_content, _model_limits, about="model")
"""Effects in the model of an estimate."""


def car_words(document: DiagnoseDocument | EstimateDocument) -> str:
    """Name the model of the car."""
    return f"{plain(document.car)} car"


def effect_name(effect: EffectName) -> str:
    """Name an effect with its place, such as ``dry friction at the front axle``."""
    name = _NAMES.get(effect.name) or plain(effect.title or effect.name.replace("_", " "))
    where = effect.where
    if not where:
        return name
    if effect.name == "clock_offset":
        return f"{where} {name}"
    if where == "both":
        return f"{name} at both axles"
    if where in svg.AXLES:
        return f"{name} at the {where} axle"
    if where.endswith(("_left", "_right")):
        return f"{name} at the {where.replace('_', ' ')} corner"
    return f"{name} of the {where.replace('_', ' ')} sensor"


def effect_lines(effects: Sequence[Effect]) -> list[str]:
    """State the effects in the model of an estimate, one sentence each."""
    return [f"In the model: {_statement(effect)}." for effect in effects]


def damper_lines(dampers: Sequence[DampingRates]) -> list[str]:
    """State shape and rates of each damper whose force is not proportional to speed."""
    lines = []
    for damper in dampers:
        name = f"{capitalized(plain(damper.element).replace('_', ' '))} damper"
        lines += [f"{name}: {_damper_shape_text(shape)}." for shape in damper.shapes]
        lines.append(f"{name}: {_rates_text(damper)}.")
    return lines


def _damper_shape_text(shape: DamperShape) -> str:
    """``digressive: its slope in fast motion is 0.27 (…) times that in slow motion``."""
    return _shape_text(
        shape, f"{shape.name}{{side}}; its slope in fast motion is {{size}} that in slow motion"
    )


def _shape_text(shape: DamperShape | SpringShape, bent: str) -> str:
    """State a shape with its probability; ``bent`` is said of a curve with bent sides."""
    text = "its force in extension is {size} that in compression"
    low, high = shape.ratio.eti95
    if low <= 1.0 <= high:
        text = f"its sides differ, but it is open which is the stronger one: {text}"
    side = "" if shape.side == "both" else f" in {shape.side}"
    size = f"{value_text(shape.ratio)} times"
    said = (text if shape.name == "unequal_sides" else bent).format(side=side, size=size)
    return f"{said} (probability {probability(shape.probability)})"


def _rates_text(damper: DampingRates) -> str:
    return (
        f"{value_text(damper.equal_power)} of equal power at the speeds driven, "
        f"{value_text(damper.at_rest)} at rest; force over speed at "
        f"{two_digits(damper.speed)} {readable_unit(damper.speed_unit)} is "
        f"{value_text(damper.compression)} in compression and "
        f"{value_text(damper.extension)} in extension"
    )


def _damper_table(dampers: Sequence[DampingRates]) -> Table:
    """Rates of dampers whose force is not proportional to speed."""
    rows = []
    for damper in dampers:
        speed = f"{two_digits(damper.speed)} {readable_unit(damper.speed_unit)}"
        values = (
            ("equal power at the speeds driven", damper.equal_power),
            ("slope at rest", damper.at_rest),
            (f"force over speed, compression at {speed}", damper.compression),
            (f"force over speed, extension at {speed}", damper.extension),
        )
        rows += _value_rows(damper.element, values)
    return Table(
        "Damping rates",
        ["damper", "rate", "value", "95 % interval"],
        rows,
        "The rate of equal power is that of the linear damper which takes as much power at the "
        "rates of deflection that were driven. It includes dry friction at the axle, and any force "
        "there that is in the model without a name; the slope and force over speed do not. The "
        "latter is given at the root mean square of these rates.",
    )


def _value_rows(element: str, values: Sequence[tuple[str, EffectValue]]) -> list[list[str]]:
    """Rows of a table: the element's name in the first, label, value and interval in each."""
    rows = []
    for n, (label, value) in enumerate(values):
        sd, (low, high) = _sd(value), value.eti95
        name = capitalized(plain(element).replace("_", " ")) if n == 0 else ""
        ends = f"{number(low, sd)} to {number(high, sd)}"
        rows.append([name, f"{label} [{readable_unit(value.unit)}]", number(value.mean, sd), ends])
    return rows


def spring_lines(springs: Sequence[SpringCurve]) -> list[str]:
    """State shape and stiffness of each spring that has a free curve."""
    lines = []
    for spring in springs:
        name = f"{capitalized(plain(spring.element).replace('_', ' '))} spring"
        lines += [f"{name}: {_spring_shape_text(shape)}." for shape in spring.shapes]
        lines.append(f"{name}: {_stiffness_text(spring)}.")
    return lines


def _spring_shape_text(shape: SpringShape) -> str:
    """``grows stiffer with travel; far from rest it is 1.8 (…) times as stiff as near rest``."""
    word = "stiffer" if shape.name == "stiffening" else "softer"
    return _shape_text(
        shape,
        f"grows {word} with travel{{side}}; far from rest it is {{size}} as stiff as near rest",
    )


def _stiffness_text(spring: SpringCurve) -> str:
    low, high = (two_digits(abs(x)) for x in spring.travel)
    unit = readable_unit(spring.unit)
    return (
        f"{value_text(spring.at_rest)} at rest; force over deflection is "
        f"{value_text(spring.compression)} at {low} {unit} of compression and "
        f"{value_text(spring.extension)} at {high} {unit} of extension"
    )


def _spring_table(springs: Sequence[SpringCurve]) -> Table:
    """Stiffness of springs that have a free curve."""
    rows = []
    for spring in springs:
        low, high = (two_digits(abs(x)) for x in spring.travel)
        unit = readable_unit(spring.unit)
        values = (
            ("slope at rest", spring.at_rest),
            (f"force over deflection at {low} {unit} of compression", spring.compression),
            (f"force over deflection at {high} {unit} of extension", spring.extension),
        )
        rows += _value_rows(spring.element, values)
    return Table(
        "Stiffness",
        ["spring", "stiffness", "value", "95 % interval"],
        rows,
        "Compression and extension are those that the recordings used, from rest.",
    )


def _spring_panel(spring: SpringCurve) -> svg.Panel:
    """Draw the force of a spring over deflection with its band, beside the nominal one."""
    words = plain(spring.element).replace("_", " ")
    figure = svg.canvas(height=1.9)
    axes = figure.subplots()
    draw_force_curve(
        axes, spring.deflection, spring.median, spring.band95, spring.nominal,
        svg.axle_colour(spring.element),
    )  # fmt: skip
    label_sides(axes, "bump", "droop")
    axes.set(
        xlabel=f"suspension deflection [{readable_unit(spring.unit)}], extension +",
        ylabel=f"{words} spring force [{readable_unit(spring.force_unit)}]\nagainst extension +",
    )
    svg.legend_above(axes)
    alt = f"{words} spring: force over deflection with its 95 % band, and the nominal force"
    return svg.panel(figure, f"spring-{spring.element.replace('_', '-')}", alt)


def clock_lines(clocks: Sequence[ClockErrors]) -> list[str]:
    """State the errors of clocks, one sentence each."""
    lines = []
    for clock in clocks:
        subject = f"Clock '{plain(clock.name)}'"
        run = f" in {plain(clock.source)}" if clock.source else ""
        if clock.offset is not None:
            text = value_text(_scaled(clock.offset, 1e3, "ms"))
            lines.append(f"{subject}: sampled {text} later than the other channels{run}.")
        if clock.drift is not None:
            text = value_text(_scaled(clock.drift, 1e6, "ppm"))
            lines.append(f"{subject}: fast by {text}{run}.")
    return lines


def _scaled(value: Summary, factor: float, unit: str) -> EffectValue:
    low, high = value.eti95
    return EffectValue(mean=factor * value.mean, eti95=[factor * low, factor * high], unit=unit)


def effect_sentence(effect: NamedEffect) -> str:
    """State an effect with its size and probability, and what it cannot be distinguished from."""
    p = effect.probability
    prefix = "" if p > _PROBABLE else "Probable: " if p > _POSSIBLE else "Possible: "
    text = f"{prefix}{_statement(effect)}; probability {probability(p)}"
    if effect.run:
        text += f"; in {plain(effect.run)} only"
    if effect.indistinguishable_from:
        others = enumerated([effect_name(other) for other in effect.indistinguishable_from], "or")
        text += f". These recordings cannot distinguish it from {others}"
        if effect.drive:
            text += f"; to tell them apart: {plain(effect.drive)}"
    return text + "."


def _statement(effect: Effect) -> str:
    """``Front damper: rebound damping is 1.48 (95 %: 1.47 to 1.49) times compression damping``."""
    values = {name: value_text(value) for name, value in effect.parameters.items()}
    sentence = _SENTENCES.get(effect.name)
    if sentence is None or not all(f"{{{name}}}" in sentence.statement for name in values):
        sizes = ", ".join(f"{plain(name)} {text}" for name, text in values.items())
        return f"{capitalized(effect_name(effect))}{': ' + sizes if sizes else ''}"
    try:
        statement = sentence.statement.format(**values)
    except KeyError:  # a document without the parameters of the effect
        return capitalized(effect_name(effect))
    place = "both" if effect.where == "both" else (effect.where or "").replace("_", " ")
    part = sentence.part.format(place.capitalize()).strip()
    return f"{part if place != 'both' else part + 's'}: {statement}"


def value_text(value: EffectValue) -> str:
    """Write a value with its unit and 95 % interval."""
    low, high = value.eti95
    unit, sd = readable_unit(value.unit), _sd(value)
    if low == high:
        return f"{value.mean:.3g} {unit}".strip()
    text = f"{number(value.mean, sd)} {unit}".strip()
    return f"{text} (95 %: {number(low, sd)} to {number(high, sd)})"


def _sd(value: EffectValue) -> float:
    """Return the standard deviation of a normal distribution with the same 95 % interval."""
    low, high = value.eti95
    return (high - low) / 3.92


def _effect_table(effects: Sequence[NamedEffect]) -> Table:
    """Every effect with its probability and parameters."""
    rows = []
    for effect in effects:
        first = [effect_name(effect), probability(effect.probability)]
        cells = _parameter_rows(effect) or [[MISSING] * 3]
        rows += [[*(first if n == 0 else ["", ""]), *row] for n, row in enumerate(cells)]
    return Table(
        "Named effects",
        ["effect", "probability", "parameter", "value", "95 % interval"],
        rows,
        "docs/effects.md defines the parameters; intervals allow for the tolerances of all others.",
    )


def _model_table(effects: Sequence[Effect]) -> Table:
    """Effects in the model of an estimate, with their parameters."""
    rows = [
        [effect_name(effect) if n == 0 else "", *row]
        for effect in effects
        for n, row in enumerate(_parameter_rows(effect) or [[MISSING] * 3])
    ]
    return Table(
        "Effects in the model",
        ["effect", "parameter", "value", "95 % interval"],
        rows,
        "Requested, or named by the diagnosis. docs/effects.md defines the parameters.",
    )


def _parameter_rows(effect: Effect) -> list[list[str]]:
    rows = []
    for name, value in effect.parameters.items():
        unit, sd = readable_unit(value.unit), _sd(value)
        low, high = value.eti95
        shown = MISSING if low == high else f"{number(low, sd)} to {number(high, sd)}"
        label = plain(name)
        rows.append([f"{label} [{unit}]" if unit else label, number(value.mean, sd), shown])
    return rows


def rate_lines(document: DiagnoseDocument) -> list[str]:
    """State compression and rebound rate of each damper in which they differ."""
    lines = []
    for place, curves in document.laws.items():
        if curves.rates is None:
            continue
        unit = readable_unit(curves.rates.unit)
        parts = []
        for side, value in (("compression", curves.rates.bound), ("rebound", curves.rates.rebound)):
            low, high = value.eti95
            sd = _sd(value)
            parts.append(
                f"{side} {number(value.mean, sd)} {unit} "
                f"(95 %: {number(low, sd)} to {number(high, sd)})"
            )
        lines.append(f"{place.replace('_', ' ').capitalize()} damper: {', '.join(parts)}.")
    return lines


def _force_curves(document: DiagnoseDocument) -> tuple[svg.Panel, ...]:
    """Draw the force of each damper over velocity and of each spring over deflection."""
    curves = [
        (place, part, curve)
        for place, laws in document.laws.items()
        for part, curve in (("damper", laws.damper), ("spring", laws.spring))
        if curve is not None
    ]
    panels = []
    for place, part, curve in curves:
        words = place.replace("_", " ")
        figure = svg.canvas(height=1.9)
        axes = figure.subplots()
        along = "velocity" if part == "damper" else "deflection"
        _draw_force(axes, curve, svg.axle_colour(place), along)
        unit, force = readable_unit(curve.unit), readable_unit(curve.force_unit)
        axes.set(
            xlabel=f"suspension {along} [{unit}], extension +",
            ylabel=f"{words} {part} force [{force}]\nagainst extension +",
        )
        alt = f"{words} {part}: force against {along}, before and after"
        key = f"law-{place.replace('_', '-')}-{part}"
        panels.append(svg.panel(figure, key, alt))
    return tuple(panels)


def _draw_force(axes: Axes, curve: ForceCurve, paint: str, along: str) -> None:
    ink, muted = svg.COLOURS["ink"], svg.COLOURS["muted"]
    grid = svg.curve_array(curve.grid)
    axes.axhline(0.0, color=muted, linewidth=0.8)
    axes.axvline(0.0, color=muted, linewidth=0.8)
    axes.plot(
        grid, svg.curve_array(curve.nominal), color=ink, linestyle=(0, (5, 3)), linewidth=1.0,
        label="nominal",
    )  # fmt: skip
    drawn = [
        (curve.before, muted, "-", "before"),
        (curve.after, paint, "-", "after"),
        (curve.after_end, paint, ":", "after, end of run"),
    ]
    for band, colour, dashes, label in drawn:
        if band is not None:
            low, high = (svg.curve_array(side) for side in band.band95)
            axes.fill_between(grid, low, high, color=colour, alpha=0.28, linewidth=0)
            axes.plot(
                grid, svg.curve_array(band.median), color=colour, linestyle=dashes, label=label
            )
    label_sides(axes, *(("compression", "rebound") if along == "velocity" else ("bump", "droop")))
    count = 3 + (curve.after_end is not None)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=count, columnspacing=1.0)
