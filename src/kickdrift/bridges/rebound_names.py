"""rebound's names for options of shared methods. This module does not import rebound."""

from __future__ import annotations

from kickdrift.integrators.options import COMPOSITION, HELIOCENTRIC, JACOBI, LAZY, MODIFIED_KICK, STANDARD

COORDINATES = {"JACOBI": JACOBI, "DEMOCRATICHELIOCENTRIC": HELIOCENTRIC}
KERNELS = {"DEFAULT": STANDARD, "LAZY": LAZY, "COMPOSITION": COMPOSITION, "MODIFIEDKICK": MODIFIED_KICK}
SABA = {"2": "4,2", "3": "6,2", "4": "8,2", "10_4": "10,4", "8_6_4": "8,6,4", "10_6_4": "10,6,4"}
PASSAGES = {  # pericentre and inner of trace, by rebound's peri_mode; rebound's encounters are always bulirsch-stoer
    "FULL_IAS15": ("full", "gauss-radau15"), "FULL_BS": ("full", "bulirsch-stoer"),
    "PARTIAL_BS": ("partial", "bulirsch-stoer"),
}  # fmt: skip
LEAPFROGS = {2: "leapfrog-dkd", 4: "forest-ruth"}  # by order


def passage_of(pericentre: str, inner: str) -> str:
    """Return rebound's peri_mode. Partial passages have one method there; without passages the mode keeps ``inner``."""
    asked = ("full" if pericentre == "none" else pericentre, inner)
    return next((mode for mode, pair in PASSAGES.items() if pair == asked), "PARTIAL_BS")


def key_of(table: dict[str, str], ours: str) -> str:
    """Return rebound's name; "" if there is none."""
    return next((theirs for theirs, name in table.items() if name == ours), "")
