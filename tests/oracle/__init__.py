"""Plain NumPy forces and integrators, other programs' references, and the tests that are theirs."""
