"""Documents of results: from what a computation returns to the typed schema."""
