"""Sequential replacement of terms: a local minimum of the predicted squared error over sets of terms.

Orthogonal functions are selected one at a time (report, 6.3.6). Where candidates are collinear, the first selection may
be a compromise that later terms make superfluous, but it is never removed. So single terms are removed, added or
exchanged, best move first, as long as the predicted squared error falls (sequential replacement; Miller, Subset
Selection in Regression, 2002). The result is no worse than the forward selection, and no single change of a term
improves it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_triangular

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.orthogonal import orthonormal, select
from bayeschute.regression.problem import read_problem
from bayeschute.regression.selection import Selection

_LEAST_GAIN = 1e-9


class Move(NamedTuple):
    """One change of the set: the term removed and the term added (one may be empty), and the PSE after it."""

    removed: str
    added: str
    pse: float


class Exchanged(NamedTuple):
    """The set of terms that no single change improves.

    Attributes:
        columns: Columns of the set, forced ones first, then by falling share of the fit that only they explain.
        terms: Their names.
        pse: Predicted squared error of the set [unit of z, squared].
        start: Predicted squared error of the selection that it began with [unit of z, squared].
        moves: The changes, in order.
    """

    columns: tuple[int, ...]
    terms: tuple[str, ...]
    pse: float
    start: float
    moves: tuple[Move, ...]


class Compressed(NamedTuple):
    """All candidates, rows in use only, in as few coordinates as they need; good for any response on these rows.

    Attributes:
        columns: Candidates of length 1 in these coordinates, (m, p).
        basis: Orthonormal basis that gives the coordinates, (n, m); None: the rows themselves.
        used: Rows in use, (N,).
    """

    columns: Float[np.ndarray, "m p"]
    basis: Float[np.ndarray, "n m"] | None
    used: Bool[np.ndarray, " N"]


def compress(X: Float[np.ndarray, "N p"], z: Float[np.ndarray, " N"]) -> Compressed:
    """Candidates in p coordinates where that saves at least half the rows.

    Args:
        X: All candidates, (N, p).
        z: A response; rows with missing values are not used, (N,).

    Returns:
        The candidates.

    Raises:
        InputError: As `read_problem`.
    """
    problem = read_problem(X, z, None, "exchange")
    length = np.linalg.norm(problem.X, axis=0)
    columns = problem.X / np.where(length > 0.0, length, 1.0)
    if 2 * columns.shape[1] > columns.shape[0]:
        return Compressed(columns, None, problem.used)
    basis, columns = np.linalg.qr(columns)
    return Compressed(columns, basis, problem.used)


def exchange(
    selection: Selection,
    X: Float[np.ndarray, "N p"],
    z: Float[np.ndarray, " N"],
    *,
    compressed: Compressed | None = None,
    most_moves: int = 200,
    tolerance: float = 1e-5,
) -> Exchanged:
    """Improve a selection by single changes until none lowers the predicted squared error.

    Args:
        selection: Starting point; its penalty, ceiling and forced terms are used.
        X: All candidates, as given to `select`, (N, p).
        z: Response, (N,).
        compressed: The candidates compressed beforehand, for many responses on the same rows; None: done here.
        most_moves: Most changes made.
        tolerance: A candidate whose remainder is below this share of its norm isn't added.

    Returns:
        The set.

    Raises:
        InputError: As `read_problem`; for options out of range.
    """
    problem = read_problem(X, z, selection.names, "exchange")
    if most_moves < 0 or not 0.0 < tolerance < 1.0:
        got = f"{most_moves} moves, tolerance {tolerance!r}"
        raise InputError(Fault("exchange", got, "moves from 0 and a tolerance between 0 and 1"))
    N, names, forced = problem.z.size, selection.names, selection.order[: selection.forced]
    if compressed is None or not np.array_equal(compressed.used, problem.used):
        compressed = compress(X, z)
    columns = compressed.columns
    y = problem.z if compressed.basis is None else compressed.basis.T @ problem.z
    outside = max(float(problem.z @ problem.z - y @ y), 0.0)
    per_term = selection.penalty_factor * selection.ceiling.value
    squares = np.einsum("ij,ij->j", columns, columns)
    now, moves = _set(list(selection.selected), columns, y, squares), list[Move]()
    cost = start = _without(None, now, tolerance)[0] + per_term * len(now.chosen)
    while len(moves) < most_moves:
        less, removed, added = _best_move(now, forced, per_term, tolerance)
        if less >= cost - _LEAST_GAIN * (cost + outside):
            break
        cost = less
        left = [j for j in now.chosen if j != removed] + ([] if added is None else [added])
        now = _set(left, columns, y, squares)
        out, put = ("" if j is None else names[j] for j in (removed, added))
        moves.append(Move(out, put, (cost + outside) / N))
    chosen = now.chosen
    chosen = [*forced, *(j for j in chosen if j not in forced)]
    if chosen:
        leading = range(len(forced))
        ranked = select(problem.X[:, chosen], problem.z, sigma_max2=selection.ceiling.value, forced=leading).order
        chosen = [chosen[k] for k in ranked] + [j for k, j in enumerate(chosen) if k not in ranked]
    terms = tuple(names[j] for j in chosen)
    return Exchanged(tuple(chosen), terms, (cost + outside) / N, (start + outside) / N, tuple(moves))


class _Set(NamedTuple):
    """Selected columns, all columns and the response, with the quantities that every change of the set needs."""

    chosen: list[int]
    columns: np.ndarray
    y: np.ndarray
    products: np.ndarray  # of the chosen columns with all
    squares: np.ndarray  # of all columns


def _set(chosen: list[int], columns: np.ndarray, y: np.ndarray, squares: np.ndarray) -> _Set:
    return _Set(chosen, columns, y, columns[:, chosen].T @ columns, squares)


def _without(removed: int | None, now: _Set, tolerance: float) -> tuple[float, np.ndarray]:
    """Sum of squares of the set without one column, and for each candidate its decrease if that is added."""
    places = [k for k, j in enumerate(now.chosen) if j != removed]
    left = [now.chosen[k] for k in places]
    basis = orthonormal(now.columns[:, left])
    residual = now.y - basis @ (basis.T @ now.y)
    along, remainder = now.columns.T @ residual, now.squares
    if left:
        triangular = basis.T @ now.columns[:, left]
        inside = solve_triangular(triangular, now.products[places], trans="T")
        remainder = now.squares - np.einsum("ij,ij->j", inside, inside)
    gain = np.where(remainder > tolerance**2, along**2 / np.maximum(remainder, tolerance**2), 0.0)
    gain[left] = 0.0
    return float(residual @ residual), gain


def _best_move(
    now: _Set, forced: tuple[int, ...], per_term: float, tolerance: float
) -> tuple[float, int | None, int | None]:
    """N times the PSE after the best single change, the column removed and the column added."""
    best: tuple[float, int | None, int | None] = (np.inf, None, None)
    for removed in [None, *(j for j in now.chosen if j not in forced)]:
        squares, gain = _without(removed, now, tolerance)
        left = len(now.chosen) - (removed is not None)
        added = int(np.argmax(gain))
        found: list[tuple[float, int | None, int | None]] = [
            (squares + per_term * left, removed, None),
            (squares - float(gain[added]) + per_term * (left + 1), removed, added),
        ]
        best = min(best, *found, key=lambda move: move[0])
    return best
