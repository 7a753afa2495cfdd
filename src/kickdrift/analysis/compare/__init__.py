"""Comparison of integrators on a user's own system, and the recommendation with its evidence.

Imports no other analysis. The command line uses `comparing` and `bench`.
"""
