"""Comparison with what a user would otherwise take, on one problem; see ``__main__``."""
