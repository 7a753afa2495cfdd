"""The flow that a method advances: y' = f(t, y) of a System or of a Problem.

Imports `options`. Steppers and methods use it.
"""
