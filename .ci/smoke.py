"""Short runs of every kind of compiled code, for machines, settings and versions that the tests do not run with."""

from __future__ import annotations

import platform
from importlib.metadata import files, version

import kickdrift as kd
from kickdrift.jit.compile import features, processor

RUNS = [  # system, method, options, steps, most relative error of the energy
    ("lj-1000", "velocity-verlet", {"dt": 0.002}, 50, 1e-3),
    ("lj-1000", "velocity-verlet", {"dt": 0.002, "precision": "mixed", "threads": 2}, 50, 1e-3),
    ("lj-binary-1000", "velocity-verlet", {"dt": 0.002}, 20, 1e-3),
    ("sun-jupiter", "leapfrog", {"dt": 0.02}, 500, 1e-4),
    ("solar-system", "wisdom-holman", {"dt": 0.01}, 200, 1e-5),
    ("solar-system", "gauss-radau15", {}, 20, 1e-12),
    ("figure-eight", "rk4", {"dt": 0.001}, 500, 1e-8),
    ("plummer-1000", "leapfrog-dkd", {"dt": 0.001}, 5, 1e-3),
    ("silicon-512", "velocity-verlet", {"dt": 0.001}, 10, 1e-4),
    ("water-512", "velocity-verlet", {"dt": 0.001}, 5, 2e-3),
]


def main() -> None:
    known = features()
    widest = next((name for name in ("avx512f", "avx2", "avx", "sse2", "neon") if name in known), "none of these")
    versions = ", ".join(f"{name} {version(name)}" for name in ("numba", "numpy", "h5py", "pydantic"))
    print(f"{processor()}, {widest}; Python {platform.python_version()}, {versions}")
    for name, method, options, steps, most in RUNS:
        report = kd.Simulation(kd.load(name), method, **options).run(steps)
        error = report.energy.max_relative_error
        print(f"  {name}, {method}, {options}: energy error {error:.2g}")
        assert error < most, (name, method, error)
    licences = [path.name for path in files("kickdrift") or () if path.name.startswith("LICENSE")]
    assert licences.count("LICENSE-three.txt") == 2, licences  # beside the viewer, and among the licences of the wheel


if __name__ == "__main__":
    main()
