"""Tables of energies: files, the curve through their points, and the rows of polynomials that compiled code reads.

Imports ``forces.seam``, ``jit`` and ``disk``. Tables of pairs are in ``forces.pairs``, those of bonds, angles and
dihedrals in ``forces.bonded``."""
