"""Where simulation and measurement disagree, what is missing, and the proof that it was."""
