"""How kickdrift compiles and caches: numba and LLVM, and no physics."""
