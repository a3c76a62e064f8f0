"""The checks on the first page: whether the model holds and whether the inputs agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from bayes_asv.report.schema import (
    CompareDocument,
    DiagnoseDocument,
    EstimateDocument,
    TrackDocument,
)
from bayes_asv.report.sections.diagnosis import diagnosis_headline
from bayes_asv.report.sections.effects import car_words
from bayes_asv.report.sections.online_filter import consistency_lines
from bayes_asv.report.sections.parameters import moved_values
from bayes_asv.report.sections.run_consistency import consistency_lines as run_consistency_lines
from bayes_asv.report.words import LABELS, number, p_value, plain

__all__ = ["Answer", "compare_checks", "diagnosis_checks", "estimate_checks", "track_checks"]

_AS_THE_VERDICT = "See the verdict above."


class Answer(NamedTuple):
    """A question of the first page with its answer."""

    question: str
    tone: str
    """``good``, ``below`` or ``muted``."""
    answer: str
    lines: Sequence[str]


def estimate_checks(
    document: EstimateDocument, model: Sequence[str], inputs: Sequence[str]
) -> list[Answer]:
    """Answer whether the model holds, whether the inputs agree, and whether the runs do.

    Parameters
    ----------
    document : EstimateDocument
        Of an estimate that was not refused.
    model, inputs : sequence of str
        What the sections say against them.
    """
    if document.verdict == "refused":
        return []
    return [
        _model_check(document, model),
        _input_check(document, inputs),
        *_run_check(document),
    ]


def _model_check(document: EstimateDocument, found: Sequence[str]) -> Answer:
    question = "Does the model hold?"
    if document.doubt and document.doubt_about == "model":
        return Answer(question, "below", "No", [_AS_THE_VERDICT, *found])
    if found:
        return Answer(question, "below", "Not entirely", found)
    p = [
        curves.whiteness_p
        for run in document.runs
        for curves in (*run.chassis.values(), *run.outputs.values())
        if curves.whiteness_p is not None
    ]
    if not p:
        return Answer(question, "muted", "Not tested", ["There are too few readings for a test."])
    checked = any(run.checks for run in document.runs)
    lines = [f"The residuals of the {car_words(document)} are white (smallest {p_value(min(p))})."]
    if checked:
        lines.append("Recordings simulated with its posterior look like the measured ones.")
    return Answer(question, "good", "Yes", lines)


def _input_check(document: EstimateDocument, found: Sequence[str]) -> Answer:
    question = "Do the inputs agree with the recordings?"
    if document.doubt and document.doubt_about == "input":
        return Answer(question, "below", "No", [_AS_THE_VERDICT, *found])
    if found:
        return Answer(question, "below", "Not entirely", found)
    moved = moved_values(document.known)
    if not moved:
        return Answer(
            question, "muted", "Not tested", ["All given values are exact: none can move."]
        )
    name = max(moved, key=lambda n: abs(moved[n]))
    size = number(abs(moved[name]), 1.0)
    label = LABELS.get(name) or plain(document.known[name].label or name)
    return Answer(
        question, "good", "Yes",
        [f"No given value moved far; the largest shift is that of the {label}, by {size} sd."],
    )  # fmt: skip


def _run_check(document: EstimateDocument) -> list[Answer]:
    consistency = document.agreement
    if consistency is None:
        return []
    tone, answer = {
        "agree": ("good", "Yes"), "disagree": ("below", "No"),
    }.get(consistency.verdict, ("muted", "Not tested"))  # fmt: skip
    lines = run_consistency_lines(document) or [_AS_THE_VERDICT]
    return [Answer("Are the runs consistent?", tone, answer, lines)]


def diagnosis_checks(document: DiagnoseDocument) -> list[Answer]:
    """Answer whether the linear car explains the recordings, and the model with what was added."""
    if document.verdict == "refused":
        return []
    p = p_value(document.p_value)
    linear = f"Does the linear {car_words(document)} explain the recordings?"
    after = "Does the model with the named effects?"
    if document.verdict == "agreement":
        return [Answer(linear, "good", "Yes", [f"They show no missing effect ({p})."])]
    left = document.unexplained.present
    answers = [Answer(linear, "below", "No", [f"It is rejected ({p})."])]
    if document.effects:
        answers.append(
            Answer(after, "below", "Not entirely", ["Something else remains unexplained."])
            if left
            else Answer(after, "good", "Yes", ["Nothing significant remains."])
        )
    elif not left:
        answers = [Answer(linear, "muted", "Within tolerances", [diagnosis_headline(document)])]
    if document.preflight:
        answers.append(
            Answer(
                "Are the recordings sound?", "muted", "Not entirely",
                ["Their faults are listed in the appendix; the fit allows for them."],
            )
        )  # fmt: skip
    return answers


def compare_checks(document: CompareDocument, model: Mapping[str, Sequence[str]]) -> list[Answer]:
    """Answer whether the model holds in both sessions, and whether they differ in something else.

    Parameters
    ----------
    document : CompareDocument
        Of two sessions.
    model : mapping of str to sequence of str
        By ``before`` and ``after``, what the sections of an estimate say against the model.
    """
    if document.verdict == "refused":
        return []
    answers = [
        _model_check(one, model[name])._replace(question=f"Does the model hold {name}?")
        for name, one in (("before", document.before), ("after", document.after))
    ]
    question, p = "Do the sessions differ in something else?", document.p_value_shared
    if p is None:
        nothing = "What both share is given as exact, or not shown by the recordings."
        return [*answers, Answer(question, "muted", "Not tested", [nothing])]
    differ = p < document.differ_below
    lines = [f"The test of what both sessions share has {p_value(p)}."]
    return [
        *answers, Answer(question, "below" if differ else "good", "Yes" if differ else "No", lines)
    ]  # fmt: skip


def track_checks(document: TrackDocument) -> list[Answer]:
    """Answer whether the filter was consistent."""
    if document.verdict == "refused":
        return []
    tone, answer = {
        "consistent": ("good", "Yes"), "recovered": ("muted", "Not all of the time"),
    }.get(document.consistency.verdict, ("below", "No"))  # fmt: skip
    return [
        Answer("Is the filter consistent?", tone, answer, consistency_lines(document)),
    ]
