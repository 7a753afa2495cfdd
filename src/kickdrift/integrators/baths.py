"""Methods of constant temperature: words over drift, kick and the flow of a heat bath."""

from __future__ import annotations

from kickdrift.integrators.splitting import Splitting, even_weights

_LANGEVIN = "Leimkuhler & Matthews 2013, Appl. Math. Res. Express 2013, 34, doi:10.1093/amrx/abs010"

ROWS = (
    Splitting(
        "baoab", "BAOAB", even_weights("BAOAB"), 2, _LANGEVIN,
        "constant temperature; exact positions in a harmonic well",
    ),
    Splitting(
        "obabo", "OBABO", even_weights("OBABO"), 2, "Bussi & Parrinello 2007, Phys. Rev. E 75, 056707, "
        "doi:10.1103/PhysRevE.75.056707", "constant temperature; comparisons",
    ),
    Splitting("aboba", "ABOBA", even_weights("ABOBA"), 2, _LANGEVIN, "constant temperature; comparisons"),
    Splitting("oabao", "OABAO", even_weights("OABAO"), 2, _LANGEVIN, "constant temperature; comparisons"),
    Splitting("baoa", "BAOA", even_weights("BAOA"), 1, "Fass et al. 2018, Entropy 20, 318, doi:10.3390/e20050318; "
        "Kieninger & Keller 2022, J. Chem. Theory Comput. 18, 7295, doi:10.1021/acs.jctc.2c00585",
        "constant temperature; both averages of a harmonic well are exact"),
    Splitting(
        "csvr", "CBABC", even_weights("CBABC"), 2,
        "Bussi, Donadio & Parrinello 2007, J. Chem. Phys. 126, 014101, doi:10.1063/1.2408420",
        "constant temperature; hardly disturbs motion",
    ),
    Splitting(
        "nose-hoover", "NBABN", even_weights("NBABN"), 2,
        "Martyna, Klein & Tuckerman 1992, J. Chem. Phys. 97, 2635, doi:10.1063/1.463940; "
        "Martyna et al. 1996, doi:10.1080/00268979600100761", "constant temperature without random numbers",
    ),
    Splitting(
        "andersen", "BABD", even_weights("BABD"), 2,
        "Andersen 1980, J. Chem. Phys. 72, 2384, doi:10.1063/1.439486", "constant temperature; no diffusion",
    ),
)  # fmt: skip
ALIASES = {"langevin": "baoab"}
