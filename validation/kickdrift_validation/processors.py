"""Older processors that numba can compile for, by numba's settings.

    python -m kickdrift_validation.processors haswell COMMAND ...

runs a command whose compiled code is for that processor.
"""

import os
import sys

FEATURES = {  # LLVM's names
    "haswell": "+avx,+avx2,+fma,+bmi,+bmi2,+lzcnt,+movbe,+f16c,+popcnt,+sse4.2",
    "x86-64": "+sse2",
}


def settings(processor: str) -> dict[str, str]:
    """The environment variables that make numba compile for the processor."""
    return {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": FEATURES[processor]}


if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1] not in FEATURES:
        sys.exit(f"usage: processors ({' | '.join(FEATURES)}) COMMAND ...")
    os.execvpe(sys.argv[2], sys.argv[2:], os.environ | settings(sys.argv[1]))
