"""Splitting coefficients carried from the digits in print to full double precision, and the package's held to them.

    python -m kickdrift_validation.polish_splittings        (needs mpmath)

Newton's method at 50 digits on the order conditions, each correction the one of least norm: where a method has more
weights than conditions, those that its authors chose freely stay as printed. A closed form is evaluated as it stands.

The conditions are found by running a step, which shares nothing with the formulas that tests/oracle takes
from the book: for every special Nyström tree (Hairer, Nørsett & Wanner 1993, Solving Ordinary Differential Equations I,
II.14, doi:10.1007/978-3-540-78862-1) one component is pulled by t^leaves times the product of the components of the
tree's branches. From rest at time 0 its exact solution is a power of t, and a method of order p has the velocity of
every tree of order p or less, and the position of every tree of order p - 1 or less, exact after one step of any size.
"""

from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain, pairwise
from math import ulp
from typing import NamedTuple

import mpmath as mp

from kickdrift.integrators.splitting.method import ROWS
from kickdrift_validation.claim import Claim, claim, main

DIGITS = 50
DIFFERENCE = mp.mpf(10) ** (-DIGITS // 2)  # step of the forward differences that make the Jacobian
RANK = 1e-12  # a singular value below this share of the largest, a free direction: they are above 8e-5 or below 1e-25
CLOSED = 1e-45  # what may be left of an order condition, and of a correction

Weights = list[mp.mpf]
Rows = tuple[Weights, Weights]  # kicks, drifts


# --- the order conditions ---

Tree = tuple[int, tuple]  # leaves, branches


@cache
def trees(order: int) -> frozenset[Tree]:
    """The special Nyström trees of an order: a smaller one with a leaf, or a branch, grown on its root."""
    if order == 1:
        return frozenset([(0, ())])
    grown = {(leaves + 1, branches) for leaves, branches in trees(order - 1)}
    for rank in range(1, order - 1):
        for leaves, branches in trees(order - 1 - rank):
            grown |= {(leaves, tuple(sorted((*branches, new)))) for new in trees(rank)}
    return frozenset(grown)


def residuals(rows: Rows, first: str, order: int) -> Weights:
    """What one step of length 1 leaves between each component and its exact solution, relative to the latter."""
    ranks = {tree: rank for rank in range(1, order + 1) for tree in sorted(trees(rank))}
    pull: dict[Tree, mp.mpf] = {}  # the exact acceleration is pull t^(rank - 1)
    for leaves, branches in ranks:
        exact = [pull[branch] / (ranks[branch] * (ranks[branch] + 1)) for branch in branches]
        pull[leaves, branches] = mp.fprod(exact)
    t, x, v = mp.mpf(0), dict.fromkeys(ranks, mp.mpf(0)), dict.fromkeys(ranks, mp.mpf(0))
    for kind, weight in alternating(rows, first):
        if kind == "kick":
            for tree in ranks:
                v[tree] += weight * t ** tree[0] * mp.fprod(x[branch] for branch in tree[1])
        else:
            t += weight
            for tree in ranks:
                x[tree] += weight * v[tree]
    velocities = [v[tree] * rank / pull[tree] - 1 for tree, rank in ranks.items()]
    positions = [x[tree] * rank * (rank + 1) / pull[tree] - 1 for tree, rank in ranks.items() if rank < order]
    return [t - 1, *velocities, *positions]


def alternating(rows: Rows, first: str) -> Iterator[tuple[str, mp.mpf]]:
    """Kicks and drifts in the order in which they act."""
    kinds = ("kick", "drift") if first == "kick" else ("drift", "kick")
    leading, other = rows if first == "kick" else rows[::-1]
    for k, weight in enumerate(leading):
        yield kinds[0], weight
        if k < len(other):
            yield kinds[1], other[k]


def polished(weights: Weights, rows: Callable[[Weights], Rows], first: str, order: int) -> Weights:
    """Newton's method: the solution of the order conditions nearest to ``weights``."""
    for _ in range(10):
        left = mp.matrix(residuals(rows(weights), first, order))
        jacobian = mp.matrix(len(left), len(weights))
        for j in range(len(weights)):
            moved = [weight + DIFFERENCE * (j == k) for k, weight in enumerate(weights)]
            jacobian[:, j] = (mp.matrix(residuals(rows(moved), first, order)) - left) / DIFFERENCE
        u, s, v = mp.svd_r(jacobian)
        rank = sum(value > RANK * s[0] for value in s)
        step = [sum((u[:, k].T * left)[0] / s[k] * v[k, j] for k in range(rank)) for j in range(len(weights))]
        weights = [weight - change for weight, change in zip(weights, step, strict=True)]
        if max(map(abs, step)) < CLOSED:
            return weights
    raise ArithmeticError("Newton's method does not converge")


def palindrome(half: Weights, middle: int = 1) -> Weights:
    """A row that reads the same from both ends and adds up to one, with one or two equal weights in the middle."""
    return [*half, *[(1 - 2 * mp.fsum(half)) / middle] * middle, *half[::-1]]


def composed(half: Weights) -> Rows:
    """Leapfrog steps in a palindrome, each half a kick, a drift, half a kick."""
    row = palindrome(half)
    return [row[0] / 2, *((p + q) / 2 for p, q in pairwise(row)), row[-1] / 2], row


class Method(NamedTuple):
    """The weights that define a method, how its rows follow from them, and whether the weights are a closed form."""

    weights: Callable[[], Weights]
    rows: Callable[[Weights], Rows]
    closed: bool = True


def printed(*digits: str) -> Callable[[], Weights]:
    return lambda: [mp.mpf(word) for word in digits]


def triple_jump() -> Weights:
    return [1 / (2 - mp.cbrt(2))]


METHODS = {
    "symplectic-euler": Method(list, lambda _: ([mp.mpf(1)], [mp.mpf(1)])),
    "symplectic-euler-dk": Method(list, lambda _: ([mp.mpf(1)], [mp.mpf(1)])),
    "velocity-verlet": Method(list, composed),
    "leapfrog-dkd": Method(list, lambda w: composed(w)[::-1]),
    # Ruth 1983: three kicks, then three drifts
    "ruth3": Method(
        lambda: [mp.mpf(p) / q for p, q in ((7, 24), (3, 4), (-1, 24), (2, 3), (-2, 3), (1, 1))],
        lambda w: (w[:3], w[3:]),
    ),
    "forest-ruth": Method(triple_jump, lambda w: composed(w)[::-1]),
    "yoshida4": Method(triple_jump, composed),
    # Omelyan, Mryglod & Folk 2002: xi, chi, and 1/2 - lambda with lambda = -0.2123418310626054
    "pefrl": Method(
        printed("0.1786178958448091", "-0.06626458266981849", "0.7123418310626054"),
        lambda w: (palindrome(w[2:], 2), palindrome(w[:2])),
        closed=False,
    ),
    # McLachlan 1995: the method of order 4 with 5 stages
    "mclachlan4": Method(
        lambda: [(14 - mp.sqrt(19)) / 108, (20 - 7 * mp.sqrt(19)) / 108, mp.mpf(2) / 5, -mp.mpf(1) / 10],
        lambda w: (palindrome(w[:2], 2), palindrome(w[2:])),
    ),
    # Blanes & Moan 2002, table 3, SRKN_6^b
    "blanes-moan4": Method(
        printed("0.0829844064174052", "0.396309801498368", "-0.0390563049223486",
                "0.245298957184271", "0.604872665711080"),
        lambda w: (palindrome(w[:3]), palindrome(w[3:], 2)),
        closed=False,
    ),
    # Yoshida 1990, table 1, solution A: w3, w2, w1
    "yoshida6": Method(printed("0.784513610477560", "0.235573213359357", "-1.17767998417887"), composed, closed=False),
    # Blanes & Moan 2002, table 3, SRKN_11^b
    "blanes-moan6": Method(
        printed("0.0414649985182624", "0.198128671918067", "-0.0400061921041533", "0.0752539843015807",
                "-0.0115113874206879", "0.123229775946271", "0.290553797799558", "-0.127049212625417",
                "-0.246331761062075", "0.357208872795928"),
        lambda w: (palindrome(w[:5], 2), palindrome(w[5:])),
        closed=False,
    ),
    # Yoshida 1990, table 2, solution D: w7 to w1
    "yoshida8": Method(
        printed("0.914844246229740", "0.253693336566229", "-1.44485223686048", "-0.158240635368243",
                "1.93813913762276", "-1.96061023297549", "0.102799849391985"),
        composed,
        closed=False,
    ),
}  # fmt: skip


def claims(long: bool = False) -> list[Claim]:
    """Two entries for each row of the package; the digits are printed on the way."""
    found: list[Claim] = []
    for row in ROWS:
        method = METHODS[row.name]
        with mp.workdps(DIGITS):
            old = method.weights()
            new = old if method.closed else polished(old, method.rows, row.first, row.order)
            before, after = (max(map(abs, residuals(method.rows(w), row.first, row.order))) for w in (old, new))
            for was, now in zip(old, new, strict=True):
                there = mp.nstr(was, 17) if method.closed else mp.nstr(was, 16)
                print(f"{row.name:20} {there:>23} -> {mp.nstr(now, 25):>32}  {float(now)!r}")
            exact = [*chain(*method.rows(new))]
            stored = [*row.kick, *row.drift]
            roundings = sum(map(ulp, stored)) / 2
            off = max(abs(a - float(b)) for a, b in zip(stored, exact, strict=True))
            missing = [float(weight) for weight in new if float(weight) not in stored]
        how = "closed form" if method.closed else f"in print {mp.nstr(before, 2)}"
        text = f"{row.name}: what is left of the conditions of order {row.order}; {how}"
        found.append(claim(text, mp.nstr(after, 2), f"at most {CLOSED:g}", bool(after <= CLOSED), "exact solution"))
        bound = f"0 where given, {roundings:.1e} where derived"
        value = off if not missing else f"not there: {missing}"
        holds = not missing and off <= roundings
        found.append(claim(f"{row.name}: the package's weights, farthest off", value, bound, holds, "nearest doubles"))
    return found


if __name__ == "__main__":
    main(claims, __doc__)
