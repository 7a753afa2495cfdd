"""Least squares, and regression with autoregressive noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kickdrift.model.state import Floats

WORTH_THREADS = 2**18  # from this many multiplications on, OpenBLAS uses threads


@dataclass(frozen=True)
class Fit:
    """One coefficient of a regression with autoregressive noise."""

    value: float
    deviation: float
    freedom: float
    unit_root_t: float
    inefficiency: float  # spectral density at zero frequency over variance: samples per independent sample


def regression(y: Floats, design: Floats, deterministic: int, rest: Floats | None = None) -> Fit:
    """Generalised least squares of ``y`` on ``design`` with autoregressive noise, for the coefficient of column
    ``deterministic`` - 1.

    ``deterministic`` is the number of leading columns in the autoregression (1: constant, 2: and trend).  The model is
    du(i) = these columns + g u(i-1) + sum d(j) du(i-j) for the least-squares residuals u. ``rest`` holds u if known. g
    = 0 is a unit root.
    """
    n, target = len(y), deterministic - 1
    rest = least_squares(design, y)[1] if rest is None else rest
    # Schwert 1989 (10.1080/07350015.1989.10509723), fewer for a short series.
    longest = min(int(12.0 * (n / 100.0) ** 0.25), n // 12)
    steps = np.diff(rest)

    def regressors(lags: int) -> tuple[Floats, Floats]:
        lagged = [steps[lags - j : len(steps) - j] for j in range(1, lags + 1)]
        return np.column_stack((design[lags + 1 :, :deterministic], rest[lags:-1], *lagged)), steps[lags:]

    # Columns are nested, so one orthogonalisation gives the residual of every order.
    matrix, right = regressors(longest)
    projections = along_each(matrix, right) ** 2
    squares = (right @ right - np.cumsum(projections)[deterministic:]) / (right @ right)
    criterion = len(right) * np.log(np.maximum(squares, 1e-30)) + np.log(len(right)) * np.arange(longest + 1)
    lags = int(np.argmin(criterion))
    solution, _, deviations = least_squares(*regressors(lags))
    root, differences = solution[deterministic], solution[deterministic + 1 :]
    unit_root_t = float(root / deviations[deterministic])

    # Near g = 0 the estimate of g is too negative by (2k + 2) / n for k deterministic columns. With var g = -2 g / n
    # this is a fraction (k + 1) / t^2 of g. In this form it vanishes where the root is well known, at any order.
    root *= max(1.0 - (deterministic + 1.0) / unit_root_t**2, 0.1)
    whitener = np.convolve([1.0, -1.0], np.concatenate(([1.0], -differences)))
    whitener[1] -= root

    def whiten(column: Floats) -> Floats:
        return np.convolve(column, whitener)[len(whitener) - 1 : len(column)]

    white = np.column_stack([whiten(column) for column in design.T])
    solution, noise, deviations = least_squares(white, whiten(y), lags + 1)
    left = len(white) - white.shape[1] - lags - 1
    # log S(0) = log variance - 2 log |A(1)|: relative variances 2 / left and 4 / t^2, matched to chi^2's 2 / freedom.
    freedom = 1.0 / (1.0 / left + 2.0 / unit_root_t**2)
    inefficiency = float(noise @ noise / left / root**2 / np.var(y - design @ solution))
    return Fit(float(solution[target]), float(deviations[target]), freedom, unit_root_t, inefficiency)


def along_each(matrix: Floats, right: Floats) -> Floats:
    """Projections of ``right`` on each column without the columns before: modified Gram-Schmidt."""
    rows, found = np.vstack((matrix.T, right)), np.empty(matrix.shape[1])
    for k in range(len(found)):
        own, others = rows[k], rows[k + 1 :]
        own /= float(np.sqrt(own @ own)) or 1.0
        along = others @ own
        others -= np.outer(along, own)
        found[k] = along[-1]
    return found


def least_squares(matrix: Floats, right: Floats, used: int = 0) -> tuple[Floats, Floats, Floats]:
    """Coefficients, residuals and standard errors. ``used`` is the number of degrees of freedom used besides the
    columns."""
    solution, inverse, norms = normal_equations(matrix, right)
    rest = right - matrix @ (solution / norms)
    solution += inverse @ (matrix.T @ rest / norms)  # one refinement compensates for the squared condition number
    rest = right - matrix @ (solution / norms)
    variance = rest @ rest / max(len(right) - len(norms) - used, 1)
    return solution / norms, rest, np.sqrt(variance * np.diag(inverse)) / norms


def normal_equations(matrix: Floats, right: Floats) -> tuple[Floats, Floats, Floats]:
    """Solution for columns divided by their norms, the inverse of their matrix, and the norms."""
    gram = products(matrix, matrix)
    norms: Floats = np.sqrt(np.diag(gram))
    norms[norms == 0.0] = 1.0
    inverse: Floats = inverse_of(gram / np.outer(norms, norms))
    return inverse @ (matrix.T @ right / norms), inverse, norms


def products(a: Floats, b: Floats) -> Floats:
    """Products of all columns of ``a`` with all of ``b``, summed over blocks of rows.

    The blocks are too small for the BLAS to use threads. On a busy processor the threads wait for each other a hundred
    times as long as the products take.
    """
    count, columns = len(a), a.shape[1] * b.shape[1]
    rows = max(1, min(count, WORTH_THREADS // columns))
    whole = count - count % rows
    of_a, of_b = (each[:whole].reshape(-1, rows, each.shape[1]) for each in (a, b))
    return np.asarray(np.matmul(of_a.transpose(0, 2, 1), of_b).sum(axis=0) + a[whole:].T @ b[whole:])


def inverse_of(gram: Floats) -> Floats:
    """Inverse of a symmetric matrix without negative eigenvalues. Eigenvalues hidden by rounding contribute nothing.

    On such a processor a matrix of 122 rows takes a hundred times as long as one of 82, for the same reason.
    """
    try:
        inverse = np.asarray(np.linalg.inv(gram), np.float64)
    except np.linalg.LinAlgError:
        inverse = np.full_like(gram, np.inf)
    if np.abs(gram).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max() < 1e10:  # seven times as fast as below
        return inverse
    values, vectors = np.linalg.eigh(gram)
    return np.asarray((vectors / np.where(values > 1e-12 * values[-1], values, np.inf)) @ vectors.T)
