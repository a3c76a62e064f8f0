"""Thresholds of the diagnosis: every level, prior and cost that decides what it reports.

Constants that only control a computation (grids, iterations, window lengths) are defined beside it.
"""

from __future__ import annotations

from typing import Final

__all__ = [
    "ALTERNATIVE_MARGIN",
    "CLEARLY_WORSE",
    "DECISIVE_EVIDENCE",
    "DISTINGUISHABLE_DISTANCE",
    "EXCESS_NOISE",
    "FIRST_ORDER_ERROR",
    "FURTHER_LEVEL",
    "LEAST_ODDS",
    "MAX_EFFECTS",
    "MIN_INFORMATION_SHARE",
    "MIN_PROBABILITY",
    "MISSPECIFICATION_LEVEL",
    "NEEDED_EVIDENCE",
    "PRIOR_NONE",
    "RELIABILITY_ALONE",
    "RELIABILITY_BESIDE_FAULT",
    "RELIABILITY_WITHOUT_ALTERNATIVE",
    "SIGNIFICANCE_LEVEL",
    "SPLIT_EVIDENCE",
    "TOLERANCE_PREFERRED",
    "UNKNOWN_SIZE_COST",
]

SIGNIFICANCE_LEVEL: Final = 0.05
"""Family-wise level of the test for a disagreement, which is its false-alarm rate."""

FURTHER_LEVEL: Final = 0.2 * SIGNIFICANCE_LEVEL
"""Level of the test for a further effect: at most four such tests, together at most 0.04."""

PRIOR_NONE: Final = 0.3
"""Prior probability that no effect is missing; the candidates share the rest in equal parts."""

MAX_EFFECTS: Final = 4
"""Largest number of effects that are named: a cause that needs more is not in the list
(docs/method.md)."""

MIN_PROBABILITY: Final = 0.1
"""Probability below which an effect is not named."""

TOLERANCE_PREFERRED: Final = 0.5
"""Probability above which the tolerances alone are the preferred explanation."""

SPLIT_EVIDENCE: Final = 5.0
"""Gain of log evidence (nats) that separate values at each place need over common ones."""

NEEDED_EVIDENCE: Final = 2.0
"""Gain of log evidence (nats) below which a named effect is removed again.

Odds of 7 : 1, "positive" evidence on the scale of Kass & Raftery 1995, J. Am. Stat. Assoc. 90, 773.
"""

DECISIVE_EVIDENCE: Final = 5.0
"""Gain of log evidence (nats, odds of 150 : 1) that an unlisted explanation needs."""

MISSPECIFICATION_LEVEL: Final = 1e-3
"""p-value below which a misspecification test, or their combination, is significant.

It applies to four tests and to a combination of three: together about five false alarms in a
thousand diagnoses, few compared with the five in a hundred of the test for a disagreement.
"""

ALTERNATIVE_MARGIN: Final = -4.0
"""Log evidence (nats) relative to the named effects above which an unlisted fault explains the data
as well as they do: it is then behind by no more than its own cost, :data:`UNKNOWN_SIZE_COST`.
"""

CLEARLY_WORSE: Final = 25.0
"""Difference of log evidence (nats) that exceeds the errors of all approximations."""

UNKNOWN_SIZE_COST: Final = 4.0
"""Cost in log evidence (nats) of a fault of unknown size, which has no prior of its own.

It is the Occam factor log(σ_prior/σ_posterior) of a parameter whose posterior standard deviation is
a fifty-fifth of the prior's.
"""

FIRST_ORDER_ERROR: Final = 0.1
"""Relative difference between the gain of a full fit and its first-order prediction."""

DISTINGUISHABLE_DISTANCE: Final = 10.0
"""Squared whitened distance above which the data distinguish two models.

It corresponds to 3.2 standard deviations of the noise along one direction.
"""

MIN_INFORMATION_SHARE: Final = 1e-6
"""Share of the information that remains after projection of nuisance parameters, below which it is
set to zero."""

EXCESS_NOISE: Final = 1.38
"""Ratio of fitted to declared noise level above which excess noise is reported.

It corresponds to 1.6 prior standard deviations: the logarithm of a declared level has a standard
deviation of 0.2.
"""

LEAST_ODDS: Final = 0.1
"""Least probability of named effects against an unlisted fault in their place.

Where that fault explained the recordings better, 1 of 21 names was true (164 development cases of
another author, ``docs/blind.md``), however large the difference of evidences.
"""

RELIABILITY_BESIDE_FAULT: Final = 0.34
"""Factor on the probability of a named effect if something unexplained was detected beside it, in
addition to its probability against an unlisted fault, which is near one for most such names.

Tuned on 1292 cars of the battery (seeds 62 and 64), where 13 of 46 such effects were true, and on
164 development cases of another author (``docs/blind.md``), where 9 of 19 were.  It applies to
effects that an unlisted fault may replace: if every unlisted fault alone is clearly worse
(:data:`CLEARLY_WORSE`), the factor is :data:`RELIABILITY_WITHOUT_ALTERNATIVE`.
"""

RELIABILITY_WITHOUT_ALTERNATIVE: Final = 0.5
"""Factor on the probability of a named effect if something unexplained was detected beside it, and
no unlisted fault alone comes near the named effects.

Of such effects 14 of 19 were true in the same cases of another author, and 8 of 29 in the battery
(seed 101 at commit 1044ba3); 22 of 48 are 46 % (33 to 60 %).
"""

RELIABILITY_ALONE: Final = 0.96
"""Factor on the probability of a named effect if nothing unexplained was detected.

A fault that is not in the list may imitate an effect so well that nothing is left.  In the battery
(seed 101 at commit 1044ba3) 312 of the 325 effects with a probability of 0.9 or more were true,
96 % (93 to 98 %); nine of the others were faults that are not in the list.
"""
