"""Compiling and caching of machine code: numba and LLVM, no physics."""
