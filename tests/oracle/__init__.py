"""Plain NumPy forces and integrators, references from other programs, and tests against these."""
