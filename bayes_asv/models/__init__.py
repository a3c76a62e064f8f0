"""Readable vehicle models, to be checked against textbooks; not optimised for speed."""
