"""Runs with deviations: the derivatives of a motion by its equations or by a method's tangent map.

Imports no other analysis. `chaos` and `derivatives` use it.
"""
