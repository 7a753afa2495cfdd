"""Writing a run's file: rows, checkpoints, and the continuation of an earlier file.

Imports `layout`, and `read` for files that are continued. The run uses `h5md`.
"""
