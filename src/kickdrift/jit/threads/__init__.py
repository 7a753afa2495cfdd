"""Threads that share the chunks of compiled code, with the same bits on any number of threads.

Imports the compiler. Kernels use `chunks`, runs use `team`.
"""
