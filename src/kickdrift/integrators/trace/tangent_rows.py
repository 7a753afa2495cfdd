"""Rows of the blocks in which the hybrid map's derivatives move.

Positions, velocities, masses; both before the drift; both after a passage of massive bodies; positions, velocities and
accelerations in the system's order for other forces; velocities before a kick by forces of velocity; what rounding took
from positions and velocities in a passage of massive bodies, for the passage's next step. Row MASSES holds G m of the
bodies, G m of the central one for the Kepler motions, and m / m_0. The central body's places in the rows
hold the centre of mass; in AFTER_X, the way of the others by the central body's motion in a passage.
"""

X, V, MASSES, MIDDLE_X, MIDDLE_V, AFTER_X, AFTER_V, OWN_X, OWN_V, OWN_A, BEFORE_V, LOST_X, LOST_V = range(13)
ROWS = 13
