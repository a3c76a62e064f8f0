"""Simulated cars with right and with mistaken inputs, to see which of them are noticed."""
