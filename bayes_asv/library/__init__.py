"""The functions and results of :mod:`bayes_asv`, and what its commands do, one module a task.

Users import :mod:`bayes_asv`; the command line imports these modules.
"""
