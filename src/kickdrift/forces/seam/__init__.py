"""The type of a kernel, called by its address; groups, arguments and names of forces.

Imports no force. Every force uses it.
"""
