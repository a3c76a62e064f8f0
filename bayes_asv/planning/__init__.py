"""Experiment design: which road, speed, sampling rate and number of passes a test needs."""
