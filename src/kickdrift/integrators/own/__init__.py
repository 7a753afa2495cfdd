"""The user's own methods: registration, measured order, and the loop around a Python step.

Imports the families whose rows users may add.
"""
