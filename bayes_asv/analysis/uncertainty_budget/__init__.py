"""Uncertainty budget: the sources of the uncertainty of each parameter, and how to reduce it.

Near its mode the posterior is that of a linear model: the error of a parameter is a sum of
independent errors, of each given value and of each reading.  ``budget`` contains the derivatives of
the innovations and the linear algebra, ``undeclared_faults`` the biases due to sensors that are not
as declared, and ``budget_of_posterior`` combines them.
"""

from bayes_asv.analysis.uncertainty_budget.budget_of_posterior import (
    EstimandBudget,
    UncertaintyBudget,
    find_budget,
)
from bayes_asv.analysis.uncertainty_budget.undeclared_faults import Shift

__all__ = ["EstimandBudget", "Shift", "UncertaintyBudget", "find_budget"]
