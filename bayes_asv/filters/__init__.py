"""Compiled kernels; they do not check their arguments.

Each kernel has a readable reference in ``bayes_asv.models`` or in the tests that holds it.
"""

from pathlib import Path

from bayes_asv.filters.cache_invalidation import forget_older

forget_older(Path(__file__).parent)
