"""The figures of a diagnosis, in its order, each with a caption that says what to look for."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.report.figures import Figure
from bayes_asv.report.readable import plain
from bayes_asv.report.svg import style

__all__ = ["diagnose_figures"]

Document = dict[str, Any]

_MOST: Final = 3  # runs whose residuals are drawn


def diagnose_figures(document: Document) -> list[Figure]:
    """Draw every figure that a diagnosis has data for.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/diagnose/1``.

    Returns
    -------
    list of Figure
        Empty for a refused document. The same document gives the same bytes.
    """
    # matplotlib costs half a second, so nothing above imports it.
    from bayes_asv.report import plots_diagnosis, plots_disagreement

    if document["verdict"] == "refused":
        return []
    found: list[Figure] = []
    with style():
        bars = plots_diagnosis.gap_bars(document)
        if bars is not None:
            found.append(
                Figure(
                    "gap",
                    "The gap before and after",
                    "Look whether the green bar comes down to the brown one on what was held out: "
                    "there nothing but start and biases was fitted. The gap is the rms difference "
                    "between measured chassis accelerations and a simulation that runs freely from "
                    "the wheels; brown is what sensor noise alone would leave of it.",
                    (bars,),
                )
            )
        found.append(
            Figure(
                "laws",
                "Force of damper and spring",
                "Look where the coloured curve leaves the grey one: that is what the linear half "
                "car lacked. Bands are 95 %, drawn over what the fitted runs visited. Bound is "
                "compression, a negative velocity, bump a negative deflection; a force that "
                "resists extension is positive.",
                plots_diagnosis.laws(document),
            )
        )
        rows = plots_diagnosis.moved(document)
        if rows is not None and document["verdict"] == "named":
            found.append(
                Figure(
                    "moved",
                    "How the parameters moved",
                    "Look how far a diamond stands from its circle: by so much the linear half car "
                    "would have told a wrong value. Bars are 95 %.",
                    (rows,),
                )
            )
        found.append(
            Figure(
                "plane",
                "Where the linear half car lacks force",
                "Look for cells of one colour side by side: a column is a matter of travel "
                "(spring, stop), a row one of velocity (damper, friction). Numbers are the mean "
                "force that the model lacks in a cell, upward on the chassis, and in brackets how "
                "many of its own deviations that is; the strongest, if beyond chance, is framed.",
                plots_disagreement.planes(document),
            )
        )
        runs = document.get("residuals") or []
        for n, run in enumerate(runs[:_MOST]):
            of = f", {plain(run['source'])}" if len(runs) > 1 else ""
            found.append(
                Figure(
                    f"left-{n}",
                    f"What the simulation leaves, before and after{of}",
                    "Look at the shaded windows: there the linear half car leaves more than "
                    "chance, and the coloured curve should have no shape of its own.",
                    plots_disagreement.windows(document, n),
                )
            )
            found.append(
                Figure(
                    f"leftband-{n}",
                    f"The spectrum of that{of}",
                    "Look at the shaded bands: low ones are motions of the body, high ones wheels, "
                    "engine or sensors.",
                    plots_disagreement.bands(document, n),
                )
            )
    return [figure for figure in found if figure.panels]
