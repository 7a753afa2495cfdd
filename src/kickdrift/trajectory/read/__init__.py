"""Reading a run's file as untrusted data: frames, samples, events, tables and damage.

Imports `layout`. Analysis, export, figures and the command line use `reader`.
"""
