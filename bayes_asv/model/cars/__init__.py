"""Cars beyond the half car: a quarter, a half with wheels, a whole one, and one that rolls.

Coordinates of a chassis are the heave z of its centre of gravity (up), the pitch θ (nose up) and
the roll φ (left side up); a place that is X ahead of the centre of gravity and Y to its left moves
by z + X θ + Y φ.  Chapter 2 of the reference shows the first three as drawings, without equations.
"""
