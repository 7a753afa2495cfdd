"""Checks of arguments: each refusal is an error of one line that names the key.

Imports nothing of the model. Everything that users call uses it.
"""
