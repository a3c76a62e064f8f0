"""Compiled arithmetic: no names, no checks, no input or output.

Each kernel has a readable reference in ``bayes_asv.model`` or in the tests that holds it.
"""
