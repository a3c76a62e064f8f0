"""What the linear car lacks: headline, findings, next steps, and faults of the recordings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from bayes_asv.diagnosis.thresholds import (
    ALTERNATIVE_MARGIN,
    DECISIVE_EVIDENCE,
    MISSPECIFICATION_LEVEL,
    SIGNIFICANCE_LEVEL,
)
from bayes_asv.report.schema import DiagnoseDocument
from bayes_asv.report.schema.diagnose import ForceCurves, RecordingFault, Unexplained
from bayes_asv.report.sections.blocks import Block, Section, Table, Text
from bayes_asv.report.sections.effects import (
    car_words,
    damper_lines,
    effect_name,
    effect_sentence,
    rate_lines,
    spring_lines,
)
from bayes_asv.report.sections.localization import where_to_look
from bayes_asv.report.sections.simulation_error import (
    asked,
    error_numbers,
    error_sentences,
    shift_sentence,
)
from bayes_asv.report.sections.unnamed_causes import unnamed_cause_lines
from bayes_asv.report.words import MISSING, enumerated, p_value, plain, readable_unit

__all__ = [
    "FAULTS_SECTION",
    "SECTION",
    "diagnosis_headline",
    "diagnosis_lines",
    "diagnosis_steps",
    "diagnosis_subtitle",
    "findings",
]

_REFUSED: Final = "No answer: these recordings do not allow a diagnosis."
_CERTAIN, _PROBABLE = 0.95, 0.7
_MAX_IN_HEADLINE: Final = 3  # effects

_FAULTS: Final = {
    "sensor_clipping": "clipped readings",
    "dropped_samples": "missing samples",
    "uneven_clock": "uneven time steps",
    "initial_state": "motion at the start",
}


def _content(document: DiagnoseDocument) -> Iterator[Block]:
    if document.verdict != "refused":
        yield Text("Findings", findings(document))


def _faults_content(document: DiagnoseDocument) -> Iterator[Block]:
    if document.preflight and document.verdict != "refused":
        rows = [
            [plain(fault.source), _FAULTS.get(fault.name, plain(fault.name)), _amount(fault)]
            for fault in document.preflight
        ]
        yield Table("Faults of the recordings", ["recording", "fault", "amount"], rows)


SECTION: Final = Section(_content)
FAULTS_SECTION: Final = Section(_faults_content, title="Faults of the recordings")


def diagnosis_subtitle(document: DiagnoseDocument) -> str:
    """Name the fitted and the held-out runs."""
    fit, held = (", ".join(map(plain, r)) for r in (document.runs.fit, document.runs.holdout))
    parts = [f"fitted: {fit}"] if fit else []
    if held:
        same = document.runs.holdout == document.runs.fit
        parts.append("held out: its second half" if same else f"held out: {held}")
    return " · ".join(parts)


def diagnosis_headline(document: DiagnoseDocument) -> str:
    """State the verdict in one to three sentences."""
    verdict, unexplained = document.verdict, document.unexplained.present
    if verdict == "refused":
        return _REFUSED
    if verdict == "agreement":
        return "These recordings show no missing effect."
    if verdict == "unexplained" and unexplained:
        something = "Something remains that no listed effect explains."
        return " ".join([something, *_falling_error(document)] if document.unnamed else [something])
    if verdict == "unexplained":
        return "Simulation and measurement disagree, but within the usual tolerances."
    sentences = [*_missing(document), *_falling_error(document)]
    if unexplained:
        sentences.append("Something else remains unexplained.")
    return " ".join(sentences)


def _falling_error(document: DiagnoseDocument) -> list[str]:
    """Say how far the simulation error falls with what was added to the model."""
    held = document.gap.holdout is not None
    error = document.gap.holdout or document.gap.fit
    runs = "held-out runs" if held else "the fitted runs"
    if error is not None and error.worse:
        return [f"But the simulation error on {runs} increased."]
    if error is None or error.closed is None:
        return []
    before, after, floor = error_numbers(error)
    it = "it" if len(document.effects) == 1 else "them"
    if document.unnamed:
        it = "this and what remains" if document.effects else "it in the model"
    return [
        f"With {it} the simulation error on {runs} falls from {before} to {after} "
        f"{readable_unit(document.gap.unit)}; sensor noise alone leaves {floor}."
    ]


def _missing(document: DiagnoseDocument) -> list[str]:
    """Sentences with the first effects by probability: lacks, probably lacks, may lack."""
    shown: dict[str, list[str]] = {}
    for effect in document.effects[:_MAX_IN_HEADLINE]:
        p = effect.probability
        lacks = "lacks" if p > _CERTAIN else "probably lacks" if p > _PROBABLE else "may lack"
        shown.setdefault(lacks, []).append(effect_name(effect))
    sentences: list[str] = []
    for lacks, names in shown.items():
        subject = "It" if sentences else f"The linear {car_words(document)}"
        sentences.append(f"{subject} {lacks} {enumerated(names)}.")
    further = len(document.effects) - _MAX_IN_HEADLINE
    if further > 0:
        sentences.append(f"{further} further effect{'s were' if further > 1 else ' was'} named.")
    return sentences


def diagnosis_lines(document: DiagnoseDocument) -> list[str]:
    """State all findings, the parameters before and after, and warnings, one sentence each.

    Text without markup; foreign text in it is on one line and without control characters.
    """
    if document.verdict == "refused":
        return [_REFUSED, *(f"Why: {plain(reason)}." for reason in document.reasons)]
    lines = [*findings(document), *error_sentences(document.gap)]
    if document.verdict == "named" or document.unnamed:
        lines += [shift_sentence(name, document) for name in asked(document)]
    return lines + [f"Note: {plain(note)}." for note in document.warnings]


def findings(document: DiagnoseDocument) -> list[str]:
    """State effects, evidence and damping rates, the most important first."""
    verdict, unexplained = document.verdict, document.unexplained
    p = p_value(document.p_value)
    if verdict == "agreement":
        lines = [
            f"The linear {car_words(document)} agrees with the measurement: these recordings show "
            f"no missing effect ({p})."
        ]
    elif verdict == "named":
        lines = [effect_sentence(effect) for effect in document.effects]
        if unexplained.present:
            lines.append("In addition, something remains that no listed effect explains.")
    elif not unexplained.present:
        lines = [
            f"Simulation and measurement disagree ({p}), but not beyond the usual tolerances of "
            "springs, dampers and sensors. No effect stands out."
        ]
    elif document.p_value < SIGNIFICANCE_LEVEL:
        lines = [f"Simulation and measurement disagree, and no listed effect explains it ({p})."]
    else:
        lines = [f"No listed effect is missing ({p}), but something remains unexplained."]
    if unexplained.present:
        lines.append(f"Evidence: {'; '.join(_evidence(unexplained))}.")
        lines += unnamed_cause_lines(document)
    lines += rate_lines(document)
    lines += damper_lines(
        [one for one in document.dampers if not _has_rates(document.laws.get(one.element))]
    )
    lines += spring_lines(document.springs)
    return lines


def _has_rates(curves: ForceCurves | None) -> bool:
    """Whether :func:`rate_lines` states the rates of a damper already."""
    return curves is not None and curves.rates is not None


def _evidence(unexplained: Unexplained) -> list[str]:
    """List what shows that something remains unexplained."""
    evidence = []
    score, ended, like = unexplained.score, _fault(unexplained.ended), _fault(unexplained.like)
    axle = f"the {plain(unexplained.axle)} axle" if unexplained.axle else "the car"
    force = f"an unknown force at {axle}"
    if score is not None and score > DECISIVE_EVIDENCE and ended != force:
        evidence.append(f"{force} explains the recordings better by {score:.0f} nats")
    if ended:
        evidence.append(f"{ended} explains the data better than any listed effect")
    if like and like != ended and _noticed(unexplained.p_decoy):
        evidence.append(f"the residuals look most like {like}")
    rival = unexplained.rival
    if rival is not None and rival > ALTERNATIVE_MARGIN:
        better = "as well" if rival < 1.0 else f"better by {rival:.0f} nats"
        closest = f" (closest: {like})" if like else ""
        instead = f"unlisted faults{closest} in place of the named effects"
        evidence.append(f"{instead} explain the recordings {better}")
    if unexplained.jitters and _noticed(unexplained.p_jitter):
        channel = plain(unexplained.jitters).replace("_", " ")
        evidence.append(
            f"noise is largest where the {channel} signal is steepest, as with jittering time "
            "stamps"
        )
    if unexplained.missing_bits:
        names = enumerated([plain(n).replace("_", " ") for n in unexplained.missing_bits])
        evidence.append(f"the converter of {names} never changes one of its bits")
    outlier = unexplained.outlier
    if outlier is not None and _noticed(outlier.p):
        channel, source = plain(outlier.channel).replace("_", " "), plain(outlier.source)
        many = f"{outlier.readings} readings" if outlier.readings > 1 else "a reading"
        fit = "fit" if outlier.readings > 1 else "fits"
        evidence.append(f"{many} of {channel} at {outlier.time:.2f} s in {source} {fit} badly")
    if _noticed(unexplained.p_memory):
        evidence.append("the innovations are autocorrelated")
    if unexplained.swollen:
        names = enumerated([plain(n).replace("_", " ") for n in unexplained.swollen])
        evidence.append(f"the noise of {names} is far above the given level")
    if unexplained.failed:
        names = enumerated([plain(n) for n in unexplained.failed])
        evidence.append(f"{names} fitted, but increased the error on held-out runs")
    return evidence or ["several weak signs, which are significant together"]


def _noticed(p: float | None) -> bool:
    return p is not None and p < MISSPECIFICATION_LEVEL


def _fault(text: str) -> str:
    """Name an unlisted fault; earlier documents call an unknown force one of free course."""
    return re.sub(
        r"^a force of free course at the (\w+)$", r"an unknown force at the \1 axle", plain(text)
    )


def diagnosis_steps(document: DiagnoseDocument) -> list[str]:
    """Say what to do next."""
    if document.verdict == "refused":
        return [
            "Correct what the reasons above name, and record again.",
            "'bayes-asv plan' shows which road and speed are sufficient.",
        ]
    steps, placed_effects = [], []
    for effect in document.effects:
        name, drive = effect_name(effect), plain(effect.drive)
        outside_model = effect.name == "engine_vibration" or bool(effect.run)
        if effect.indistinguishable_from and drive:
            others = enumerated([effect_name(o) for o in effect.indistinguishable_from], "or")
            steps.append(f"To distinguish {name} from {others}: {drive}.")
        elif outside_model:
            steps.append(f"To confirm {name}: {drive}.")
        if not outside_model:
            where = f"@{plain(effect.where)}" if effect.where else ""
            placed_effects.append(f"--with {plain(effect.name)}{where}")
    if placed_effects:
        steps.append(
            "Inspect the part. If it is as designed, or until it is repaired, include the effect "
            f"in the model: bayes-asv estimate … {' '.join(placed_effects)}."
        )
    if document.unexplained.present:
        steps.append(where_to_look(document))
    if document.gap.fit is not None and document.gap.holdout is None:
        steps.append("Record a drive over another road and give it as --holdout, as a validation.")
    if document.verdict == "agreement":
        steps.append(
            "Nothing needs to be added to the model. "
            "A weaker effect needs a harder or longer drive."
        )
    return steps or [
        "Repeat the drive: chance does not repeat, and a fault shows more clearly in a longer or "
        "harder drive.",
        "Calibrate the sensors together and weigh what was guessed: the smaller the tolerances, "
        "the smaller the faults that can be named.",
    ]


def _amount(fault: RecordingFault) -> str:
    if fault.samples is not None:
        return f"{fault.samples} samples"
    if fault.rms_seconds:
        return f"{1e3 * fault.rms_seconds:.3g} ms rms"
    return f"{fault.times_noise:.0f} times the sensor noise" if fault.times_noise else MISSING
