"""`trace`: a Wisdom-Holman map that resolves encounters; systems in lanes, and derivatives.

Imports `wisdom_holman` and `gauss_radau`.
"""
