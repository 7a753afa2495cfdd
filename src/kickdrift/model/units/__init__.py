"""Unit systems, physical constants, and quantities written as text with a unit.

Imports nothing of the model but hints for names. Everything that has a dimension uses it.
"""
