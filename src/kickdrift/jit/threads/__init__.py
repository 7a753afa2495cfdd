"""Threads that share the chunks of compiled code, with the same bits on any number of threads.

Imports the compiler. Kernels and runs use `chunks`.
"""
