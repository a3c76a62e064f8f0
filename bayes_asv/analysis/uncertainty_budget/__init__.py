"""What makes each answer as wide as it is, and what would make it narrower.

Near its mode the posterior is that of a linear model: the answer's error is a sum of
independent errors, of every value that was given and of every reading.  ``budget`` has the
derivatives of the innovations and the algebra, ``undeclared_faults`` what a sensor that is not as
declared does to the answers, and ``budget_of_posterior`` puts them together.
"""

from bayes_asv.analysis.uncertainty_budget.budget_of_posterior import (
    EstimandBudget,
    UncertaintyBudget,
    find_budget,
)
from bayes_asv.analysis.uncertainty_budget.undeclared_faults import Shift

__all__ = ["EstimandBudget", "Shift", "UncertaintyBudget", "find_budget"]
