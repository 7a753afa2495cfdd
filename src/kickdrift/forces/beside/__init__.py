"""Unknowns beside the bodies: further columns of y, such as spins, and the user's own equations, which bodies feel.

``columns`` is the mechanism, and ``unknowns`` the user's equations; ``forces.around.spins`` is another user of it.
Imports the seam and the laws."""
