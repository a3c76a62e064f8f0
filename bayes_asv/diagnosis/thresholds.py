"""Thresholds of the diagnosis: every level, prior and cost that decides what it reports.

Constants that only steer a computation (grids, rounds, window lengths) stay beside it.
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
    "MAX_EFFECTS",
    "MIN_INFORMATION_SHARE",
    "MIN_PROBABILITY",
    "MISSPECIFICATION_LEVEL",
    "NEEDED_EVIDENCE",
    "PRIOR_NONE",
    "RELIABILITY_BESIDE_FAULT",
    "RELIABILITY_WITH_ALTERNATIVE",
    "SIGNIFICANCE_LEVEL",
    "SPLIT_EVIDENCE",
    "TOLERANCE_PREFERRED",
    "UNKNOWN_SIZE_COST",
]

SIGNIFICANCE_LEVEL: Final = 0.05
"""Family-wise level of the test for a disagreement: the accepted rate of false alarms."""

FURTHER_LEVEL: Final = 0.2 * SIGNIFICANCE_LEVEL
"""Level for each further effect: at most four such tests, together below one more level of 0.05."""

PRIOR_NONE: Final = 0.3
"""Prior probability that no effect is missing; the effects share the rest in equal parts."""

MAX_EFFECTS: Final = 4
"""Effects that one diagnosis names: what needs more is not in the list (docs/method.md)."""

MIN_PROBABILITY: Final = 0.1
"""Probability below which an effect is not named."""

TOLERANCE_PREFERRED: Final = 0.5
"""Probability of the tolerances alone from which they are the preferred explanation."""

SPLIT_EVIDENCE: Final = 5.0
"""Log evidence (nats) that separate values at each place have to gain over common ones."""

NEEDED_EVIDENCE: Final = 2.0
"""Log evidence (nats) below which a named effect is removed again.

Odds of 7 : 1, "positive" evidence in the scale of Kass & Raftery 1995, J. Am. Stat. Assoc. 90, 773.
"""

DECISIVE_EVIDENCE: Final = 5.0
"""Log evidence (nats, odds of 150 : 1) by which an unlisted explanation has to win."""

MISSPECIFICATION_LEVEL: Final = 1e-3
"""p-value below which a misspecification test, or their combination, is significant.

Three tests and their combination are held against it: together some four false alarms in a
thousand diagnoses, few beside the five in a hundred of the test for a disagreement.
"""

ALTERNATIVE_MARGIN: Final = -4.0
"""Log evidence (nats) from which an unlisted fault explains as well as the named effects.

It is then behind them by no more than its own cost, :data:`UNKNOWN_SIZE_COST`.
"""

CLEARLY_WORSE: Final = 25.0
"""Log evidence (nats) by which an explanation is behind another where no approximation matters."""

UNKNOWN_SIZE_COST: Final = 4.0
"""Log evidence (nats) that a fault of unknown size costs, which has no prior of its own.

It is the Occam factor log(σ_prior/σ_posterior) of a parameter that the data determine to a
fifty-fifth of its prior's width.
"""

FIRST_ORDER_ERROR: Final = 0.1
"""Share of a gain by which a full fit may fall short of the first order, or the other way round."""

DISTINGUISHABLE_DISTANCE: Final = 10.0
"""Squared whitened distance beyond which the data tell two explanations apart.

It is 3.2 standard deviations of the noise along one direction.
"""

MIN_INFORMATION_SHARE: Final = 1e-6
"""Share of information beside nuisance parameters below which it is taken to be zero."""

EXCESS_NOISE: Final = 1.38
"""Fitted over given noise level from which noise is said to be in excess.

It is 1.6 deviations of the prior of a given level, whose logarithm has a deviation of 0.2.
"""

RELIABILITY_BESIDE_FAULT: Final = 0.28
"""Factor on the probability of a named effect beside which something unexplained was detected.

Tuned on 1292 cars of the battery (seeds 62 and 64), of whose named effects 13 of 46 were true.  It
stands for effects that an unlisted fault may replace: where every one of these alone is clearly
worse (:data:`CLEARLY_WORSE`), the factor is :data:`RELIABILITY_WITH_ALTERNATIVE`.
"""

RELIABILITY_WITH_ALTERNATIVE: Final = 0.9
"""The same where an unlisted fault alone explains the recordings as well as the named effects.

Tuned on 453 cars of the battery (seeds 5, 11, 31 and 32), of whose named effects 44 of 55 were true
(80 %, 95 % interval 68 to 88 %).
"""
