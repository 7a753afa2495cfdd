"""Explicit Runge-Kutta methods: Butcher tableaus, one loop of fixed steps and one of chosen steps; and SciPy's solvers.

Imports `stepping`.
"""
