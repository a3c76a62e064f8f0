"""What the results of all functions share: verdict, parameters, tables, JSON and reports."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Literal, overload

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, write_atomically
from bayes_asv.library.extras import import_extra
from bayes_asv.library.parameter import Parameter
from bayes_asv.report.words import (
    NOT_DETERMINED,
    is_determined,
    number,
    plain,
    probability,
    readable_unit,
)

if TYPE_CHECKING:
    import pandas as pd

    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["DocumentResult", "Result", "html_table", "json_text"]

Units = Literal["vehicle", "SI", "US"]

_MAX_NAME = 60  # characters of the car's name in a repr
_MAX_REASON = 160  # characters of a reason in a repr


class DocumentResult:
    """Base class of all results: a typed document with a verdict, as JSON, pages and sentences.

    Parameters
    ----------
    document : pydantic model
        The typed document that :meth:`to_json` writes.
    """

    def __init__(self, document: Any):
        self.document = document

    @property
    def verdict(self) -> str:
        """Verdict, ``"refused"`` if the recordings cannot answer."""
        return str(self.document.verdict)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the answer was refused; empty otherwise."""
        return tuple(self.document.reasons)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What limits the answer."""
        return tuple(self.document.warnings)

    @overload
    def to_json(self, path: None = None) -> str: ...
    @overload
    def to_json(self, path: PathLike) -> None: ...
    def to_json(self, path: PathLike | None = None) -> str | None:
        """Write the document that the command line writes with ``--json``.

        Parameters
        ----------
        path : str or os.PathLike, optional
            The file; without it the text is returned.
        """
        text = json_text(self.document.to_dict())
        if path is None:
            return text
        write_atomically(path, text.encode("utf-8", "replace"))  # a name need not be Unicode
        return None

    def report(self, path: PathLike) -> None:
        """Write a report, HTML or PDF by the suffix of the file.

        Parameters
        ----------
        path : str or os.PathLike
            Ends in ``.html`` or ``.pdf``.

        Raises
        ------
        InputError
            If the suffix is another one or the file cannot be written.
        """
        from bayes_asv.report.render import write_report

        write_report(self.document, path)

    def lines(self) -> list[str]:
        """State the result in sentences."""
        raise NotImplementedError

    def __str__(self) -> str:
        return "\n".join(self.lines())


class Result(DocumentResult):
    """Base class of the results of ``estimate``, ``diagnose`` and ``track``.

    ``result["c_f"]`` is a :class:`Parameter`, in the vehicle's units.  A refusal is a result
    without parameters whose ``reasons`` say why.

    Parameters
    ----------
    document : pydantic model
        The typed document that :meth:`to_json` writes.
    parameters : mapping of str to Parameter
        In the vehicle's units.
    vehicle : Vehicle
        The car.
    """

    def __init__(self, document: Any, parameters: Mapping[str, Parameter], vehicle: Vehicle):
        super().__init__(document)
        self.parameters = dict(parameters)
        self.vehicle = vehicle

    def __getitem__(self, name: str) -> Parameter:
        if name in self.parameters:
            return self.parameters[name]
        if not self.parameters:
            why = "; ".join(self.reasons) or f"the verdict is {self.verdict!r}"
            raise KeyError(f"there is no {name}: {why}")
        raise KeyError(f"there is no {name}; there are {', '.join(self.parameters)}")

    def __contains__(self, name: object) -> bool:
        return name in self.parameters

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters)

    def keys(self) -> Iterator[str]:
        """Names of the parameters, so that ``dict(result)`` works."""
        return iter(self.parameters)

    def summary(self, units: Units = "vehicle") -> pd.DataFrame:
        """Return the parameters as a table.

        Parameters
        ----------
        units : {'vehicle', 'SI', 'US'}
            System of units; by default that of the vehicle file.

        Returns
        -------
        pandas.DataFrame
            One row a parameter: ``mean``, ``sd``, ``median``, ends of the equal-tailed 95 %
            interval ``eti95_lb`` and ``eti95_ub``, ``nominal``, ``p_below_nominal``, ``unit``.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        if units not in ("vehicle", "SI", "US"):
            raise InputError(
                f"units {units!r}", "is not a system of units", 'use "SI" or "vehicle"'
            )
        pandas = import_extra("pandas", "summary()")
        columns = (
            "mean", "sd", "median", "eti95_lb", "eti95_ub", "nominal", "p_below_nominal", "unit",
        )  # fmt: skip
        rows = [
            (p.mean, p.sd, p.median, *p.interval(), p.nominal, p.probability_below_nominal, p.unit)
            for p in (
                p if units == "vehicle" else p.to(units) for p in self.parameters.values()
            )
        ]  # fmt: skip
        index = pandas.Index(list(self.parameters), name="parameter")
        return pandas.DataFrame(rows, index=index, columns=columns)

    def __repr__(self) -> str:
        car = plain(self.vehicle.name)[:_MAX_NAME]
        about = ", ".join(
            f"{p.name} {number(p.mean, p.sd)} ± {number(p.sd, p.sd)} {readable_unit(p.unit)}"
            if is_determined(p.interval())
            else f"{p.name} {NOT_DETERMINED}"
            for p in list(self.parameters.values())[:3]
        )
        if not about:
            about = plain("; ".join(self.reasons))[:_MAX_REASON]
        return f"<{type(self).__name__} {self.verdict!r} of {car}: {about or 'no parameters'}>"

    def _repr_html_(self) -> str:
        first, *others = self.lines()
        rows = [
            (
                p.label, _mean(p), " to ".join(number(x, p.sd) for x in p.interval()),
                readable_unit(p.unit), number(p.nominal), probability(p.probability_below_nominal),
            )
            for p in self.parameters.values()
        ]  # fmt: skip
        head = ("parameter", "mean", "95 %", "unit", "nominal", "P(below nominal)")
        return html_table(first, head, rows, self._notes(others))

    def _notes(self, lines: list[str]) -> list[str]:
        """Sentences that a notebook shows below the table: those that it does not repeat."""
        return [line for line in lines if line.startswith(("Why: ", "Note: ", "Next: "))]


def json_text(document: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Write a document as JSON.

    Parameters
    ----------
    document : mapping
        Plain data without NaN and infinities.
    ascii_only : bool
        Escape other letters, for terminals and pipes of any encoding.
    """
    return json.dumps(document, indent=1, ensure_ascii=ascii_only, allow_nan=False) + "\n"


def html_table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()
) -> str:
    """Write a title, a table and notes for a notebook; all of it is escaped."""
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows
    )
    table = f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>" if rows else ""
    items = "".join(f"<li>{escape(text)}</li>" for text in notes)
    return f"<div><b>{escape(title)}</b>{table}<ul>{items}</ul></div>"


def _mean(parameter: Parameter) -> str:
    if not is_determined(parameter.interval()):
        return NOT_DETERMINED
    return number(parameter.mean, parameter.sd)
