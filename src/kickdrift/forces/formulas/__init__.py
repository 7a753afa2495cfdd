"""Laws from formulas that are text: OpenMM's notation, its derivative, and the law as code.

Imports only errors, text and values. `FormulaPair` and the four classes beside `FormulaBond` are forces of these
laws.
"""
