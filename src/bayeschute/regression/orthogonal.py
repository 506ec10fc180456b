"""Structure selection by multivariate orthogonal functions (report, 6.3.6; table and print-out of 7.3).

Each candidate column is orthogonalised against the selected ones; the remainder psi that lowers the mean squared error
most is selected next. With h orthonormal to all selected before, the matrix is not overwritten: the squared norms of
the remainders are updated by ``|psi_j|^2 -= (x_j . h)^2`` and recomputed from the column where cancellation has lost
half the digits (the safeguard of LAPACK's pivoted QR). One pass over the matrix per selected term.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.noise_ceiling import Ceiling, noise_ceiling
from bayeschute.regression.problem import Problem, group_variance, positive, read_problem, row_labels
from bayeschute.regression.selection import Row, Selection

_CANCELLED = float(np.sqrt(np.finfo(float).eps))
_ROUNDING = 1e-13
_CHUNK = 256


def select(
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    names: Sequence[str] | None = None,
    *,
    indices: Sequence[str] | None = None,
    groups: Sequence[Hashable] | np.ndarray | None = None,
    rule: str | None = None,
    sigma_max2: float | None = None,
    noise_variance: float | None = None,
    penalty_factor: float = 2.0,
    max_terms: int = 300,
    drop_tolerance: float = 1e-6,
    forced: Sequence[int] = (),
) -> Selection:
    """Rank candidate columns and keep those up to the global minimum of the predicted squared error (6.3.6-11).

    Rows with a NaN are left out. Columns of zeros, copies and combinations of chosen columns are dropped and listed.
    More candidates than rows are allowed. Rows may come in any order.

    Args:
        X: Candidates; for a vector response the stacked components, (N, p).
        z: Response, (N,).
        names: Name of each candidate; ``x1, x2, ...`` if None.
        indices: The report's decimal index of each candidate, for the print-out; column numbers if None.
        groups: Label of each row, e.g. which vector component it is; the variance of z is taken about the mean of
            each group, so that turning the axes changes nothing. None: one group.
        rule: See `noise_ceiling`; None: "fixed" if sigma_max2 is given, else "25 sigma^2" if noise_variance is,
            else "default".
        sigma_max2: sigma_max^2 of rule "fixed" [unit of z, squared].
        noise_variance: sigma^2 from smoothing [unit of z, squared].
        penalty_factor: f. The report's equation has 1, its printed table fits 2 only.
        max_terms: Longest path; `Selection.certain` is whether it was long enough.
        drop_tolerance: A candidate is dropped when its remainder is below this share of its own norm. 1e-6 also
            removes copies that went through single precision.
        forced: Columns chosen first and always kept, in this order.

    Returns:
        The path, its ranking and the terms kept.

    Raises:
        InputError: For wrong shapes, infinite values, no usable rows, or values out of range.
    """
    problem = read_problem(X, z, names, "select")
    N, p = problem.X.shape
    _check_options(p, penalty_factor, max_terms, drop_tolerance, forced, indices)
    labels = row_labels(groups, problem.used.size, "select groups")[problem.used]
    variance = group_variance(problem.z, labels)
    ceiling = noise_ceiling(rule, variance=variance, sigma_max2=sigma_max2, noise_variance=noise_variance)
    path = _greedy(problem, min(max_terms, N, p), drop_tolerance, tuple(forced))
    rows = _ranking(path, problem, indices, variance)
    return _selection(path, problem, rows, ceiling, penalty_factor, len(forced))


def _selection(
    path: _Path, problem: Problem, rows: tuple[Row, ...], ceiling: Ceiling, penalty_factor: float, forced: int
) -> Selection:
    """The path and what it is judged by, at the minimum of the predicted squared error."""
    K = len(path.order)
    bare = Selection(
        names=problem.names,
        order=path.order,
        rows=rows,
        minimum=0,
        estimate=np.zeros(0),
        ceiling=ceiling,
        penalty_factor=penalty_factor,
        samples=problem.z.size,
        mean_square=float(np.mean(problem.z**2)),
        dropped=tuple((problem.names[j], n) for j, n in path.dropped),
        exhausted=path.exhausted,
        certain=False,
        forced=forced,
        orthogonal_estimate=path.a,
        triangular=path.triangular[:K, :K].copy(),
    )
    return bare.with_ceiling(ceiling)


def _check_options(
    p: int,
    penalty_factor: float,
    max_terms: int,
    drop_tolerance: float,
    forced: Sequence[int],
    indices: Sequence[str] | None,
) -> None:
    positive("select penalty_factor", penalty_factor)
    if not 0.0 < drop_tolerance < 1.0:
        raise InputError(Fault("select drop_tolerance", repr(drop_tolerance), "a share between 0 and 1"))
    if max_terms < max(1, len(forced)):
        raise InputError(Fault("select max_terms", str(max_terms), "at least 1 and the number of forced columns"))
    if len(set(forced)) != len(forced) or any(not 0 <= j < p for j in forced):
        raise InputError(Fault("select forced", str(list(forced)), f"different columns from 0 to {p - 1}"))
    if indices is not None and len(indices) != p:
        raise InputError(Fault("select indices", f"{len(indices)} indices", f"one for each of the {p} columns"))


class _Path(NamedTuple):
    order: tuple[int, ...]
    a: np.ndarray
    triangular: np.ndarray
    mse: np.ndarray
    dropped: tuple[tuple[int, int], ...]
    exhausted: bool


def _greedy(problem: Problem, limit: int, tolerance: float, forced: tuple[int, ...]) -> _Path:
    X, z = problem.X, problem.z
    N = z.size
    own = np.einsum("ij,ij->j", X, X)
    squared, exact, alive = own.copy(), own.copy(), own > 0.0
    dropped = [(int(j), 0) for j in np.flatnonzero(~alive)]
    H, R, a, mse = np.empty((limit, N)), np.zeros((limit, limit)), np.zeros(limit), np.zeros(limit)
    residual, order = z.copy(), list[int]()
    total = seen = float(z @ z)
    along = X.T @ residual
    exhausted = False
    while len(order) < limit:
        k = len(order)
        if k >= len(forced) and (seen <= _ROUNDING**2 * total or not alive.any()):
            exhausted = True
            break
        j = forced[k] if k < len(forced) else _best(along, squared, alive)
        psi, shares = _orthogonalised(X[:, j], H[:k])
        norm2 = float(psi @ psi)
        if norm2 <= tolerance**2 * own[j]:
            if k < len(forced):
                raise InputError(
                    Fault(f"select forced {problem.names[j]!r}", "a combination of earlier ones", "independent columns")
                )
            alive[j] = False
            dropped.append((j, k))
            continue
        h = psi / np.sqrt(norm2)
        a[k] = h @ residual
        residual -= a[k] * h
        H[k], R[:k, k], R[k, k] = h, shares, np.sqrt(norm2)
        order.append(j)
        alive[j] = False
        now = float(residual @ residual)
        mse[k] = now / N
        on_h = X.T @ h
        squared -= on_h**2
        # the update loses digits once the residual has shrunk much; then the products are taken afresh
        if now < 1e-6 * seen or k % 32 == 31 or now <= _ROUNDING**2 * total:
            along, seen = X.T @ residual, now
        else:
            along -= a[k] * on_h
        _recompute(X, H[: k + 1], squared, exact, alive)
        for gone in np.flatnonzero(alive & (squared <= tolerance**2 * own)):
            alive[gone] = False
            dropped.append((int(gone), k + 1))
    else:
        exhausted = not alive.any() or float(residual @ residual) <= _ROUNDING**2 * total
    K = len(order)
    return _Path(tuple(order), a[:K].copy(), R, mse[:K], tuple(dropped), exhausted)


def _best(along: np.ndarray, squared: np.ndarray, alive: np.ndarray) -> int:
    score = np.full(along.size, -1.0)
    score[alive] = np.abs(along[alive]) / np.sqrt(np.maximum(squared[alive], np.finfo(float).tiny))
    return int(np.argmax(score >= score.max() * (1.0 - 1e-12)))


def orthonormal(columns: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "N n"]:
    """Orthonormal basis of a few independent columns, in their order (Gram-Schmidt twice, as along a path).

    For few columns this beats LAPACK's QR, whose threads wait for each other on a busy machine.
    """
    H = np.empty((columns.shape[1], columns.shape[0]))
    for k in range(columns.shape[1]):
        psi, _ = _orthogonalised(columns[:, k], H[:k])
        H[k] = psi / np.linalg.norm(psi)
    return H.T


def _orthogonalised(x: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    shares = H @ x
    psi = x - shares @ H
    again = H @ psi
    return psi - again @ H, shares + again


def _recompute(X: np.ndarray, H: np.ndarray, squared: np.ndarray, exact: np.ndarray, alive: np.ndarray) -> None:
    stale = np.flatnonzero(alive & (squared <= _CANCELLED * exact))
    for start in range(0, stale.size, _CHUNK):
        columns = stale[start : start + _CHUNK]
        psi = X[:, columns]
        for _ in range(2):
            psi = psi - H.T @ (H @ psi)
        squared[columns] = exact[columns] = np.einsum("ij,ij->j", psi, psi)


def _ranking(path: _Path, problem: Problem, indices: Sequence[str] | None, variance: float) -> tuple[Row, ...]:
    N, rms = problem.z.size, float(np.sqrt(np.mean(problem.z**2)))
    rows = []
    for k, j in enumerate(path.order):
        mse = float(path.mse[k])
        rows.append(
            Row(
                n=k + 1,
                index=str(indices[j]) if indices is not None else str(j),
                term=problem.names[j],
                a=float(path.a[k] / path.triangular[k, k]),
                dmse=-float(path.a[k] ** 2) / N,
                mse=mse,
                pse=np.nan,
                perr=100.0 * float(np.sqrt(mse)) / rms,
                r2=100.0 * (1.0 - mse / variance) if variance > 0.0 else np.nan,
                f_ratio=np.nan,
                pe=np.nan,
            )
        )
    return tuple(rows)
