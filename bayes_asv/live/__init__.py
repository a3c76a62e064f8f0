"""The online filter shown while it runs: in a browser, in a terminal, or as an animation."""
