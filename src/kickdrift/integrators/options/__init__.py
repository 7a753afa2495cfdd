"""Options of integrators, each declared once: name, type, unit, default, choices, help.

Imports no other part of the layer. Methods declare with it; everything that asks for options reads it.
"""
