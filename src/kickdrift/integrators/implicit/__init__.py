"""Implicit Runge-Kutta and Rosenbrock methods.

Imports `stepping`.
"""
