"""Many-body forces: embedded atoms, Stillinger-Weber, Tersoff.

Imports `lists` and the kernel of `pairs`.
"""
