"""Columns of the table that looks at a run are written into (``looking``); without numba, for those who only read."""

from __future__ import annotations

# Potential energy, virial and pairs are neighbours: the forces add to the three of them.
TIME, POTENTIAL, VIRIAL, PAIRS, KINETIC, TOTAL, TEMPERATURE, PRESSURE = range(8)
MOMENTUM, ANGULAR, CENTRE, VELOCITY = 8, 11, 14, 17  # three each
ENERGY_TAKEN, MOMENTUM_TAKEN, ANGULAR_TAKEN = 20, 21, 24  # by events so far; one, three, three
COLUMNS = 27
