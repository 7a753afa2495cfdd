"""Hard spheres from hit to hit: the times of contacts and of walls in closed form.

Imports `stepping`.
"""
