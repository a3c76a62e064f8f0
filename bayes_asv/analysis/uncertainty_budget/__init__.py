"""What makes each answer as wide as it is, and what would make it narrower.

Near its mode the posterior is that of a linear model: the answer's error is a sum of
independent errors, of every value that was given and of every reading.  ``sensitivity`` has
the derivatives of the innovations, ``sources`` what they say when one noise is another,
``faults`` what a recording looks like when a sensor is not as declared, ``shifts`` what that
does to the answers, ``budget`` the algebra, and ``find`` puts them together.
"""

from bayes_asv.analysis.uncertainty_budget.budget_of_posterior import (
    Answer,
    UncertaintyBudget,
    find_budget,
)
from bayes_asv.analysis.uncertainty_budget.undeclared_faults import Shift

__all__ = ["Answer", "Shift", "UncertaintyBudget", "find_budget"]
