"""Which terms a record can carry: multivariate orthogonal functions (report, 6.3.6; table and print-out of 7.3).

Each candidate column is stripped of what the chosen ones already explain; the remainder psi that lowers the mean
squared error most is chosen next. With h orthonormal to all chosen before, nothing of the matrix is overwritten: the
squared norms of the remainders are updated by ``|psi_j|^2 -= (x_j . h)^2`` and recomputed from the column where
cancellation has eaten half the digits (the safeguard of LAPACK's pivoted QR). One pass over the matrix per row.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_triangular

from bayeschute.errors import Fault, InputError

_CANCELLED = float(np.sqrt(np.finfo(float).eps))
_ROUNDING = 1e-13
_SMALLEST, _LARGEST = 1e-60, 1e60
_CHUNK = 256
REPORT_SAFETY = 25.0


class Problem(NamedTuple):
    """A regression as given, checked: rows with a missing value are left out.

    Attributes:
        X: Columns, rows in use only, (n, p).
        z: Response, rows in use only, (n,).
        names: Name of each column.
        used: Which of the rows given are in use, (N,).
    """

    X: Float[np.ndarray, "n p"]
    z: Float[np.ndarray, " n"]
    names: tuple[str, ...]
    used: Bool[np.ndarray, " N"]


class Ceiling(NamedTuple):
    """The sigma_max^2 of the predicted squared error and where it comes from.

    Attributes:
        value: sigma_max^2 [unit of z, squared].
        rule: ``"fixed"``, ``"smoothing"``, ``"25 sigma^2"`` or ``"default"``.
        noise_variance: sigma^2 that the F ratio divides by [unit of z, squared].
        sentence: The rule in words.
    """

    value: float
    rule: str
    noise_variance: float
    sentence: str


@dataclass(frozen=True)
class Row:
    """One row of the print-out (report, 7.3): the model after the n-th orthogonal function.

    Attributes:
        n: Number of functions in the model.
        index: The report's decimal index of the candidate (last digit: power of variable 1).
        term: Name of the candidate.
        a: Coefficient of the remainder psi, whose own candidate enters with factor 1 [unit of z / unit of term].
        dmse: Change of the mean squared error, -a^2 psi'psi/N; negative [unit of z, squared].
        mse: Mean squared error [unit of z, squared].
        pse: Predicted squared error, mse + f sigma_max^2 n/N [unit of z, squared].
        perr: 100 sqrt(mse)/rms(z) [%].
        r2: 100 (1 - mse/variance of z about its mean), the report's 100 (1 - mse_n/mse_1) when row 1 is the
            constant [%]; NaN for a response that doesn't vary.
        f_ratio: |dmse| N/(N - n)/sigma^2 as the report prints it (the textbook's F ratio is N times as large).
        pe: sqrt(pse) [unit of z].
    """

    n: int
    index: str
    term: str
    a: float
    dmse: float
    mse: float
    pse: float
    perr: float
    r2: float
    f_ratio: float
    pe: float


class Structure(NamedTuple):
    """The terms kept under one sigma_max^2.

    Attributes:
        sigma_max2: sigma_max^2 asked about [unit of z, squared].
        n: Number of terms kept.
        terms: Their names, in order of choice.
        low: The same terms are kept from this sigma_max^2 ...
        high: ... up to (not including) this one.
        certain: False if the path was cut before the minimum was sure to be the global one.
    """

    sigma_max2: float
    n: int
    terms: tuple[str, ...]
    low: float
    high: float
    certain: bool


@dataclass(frozen=True)
class Selection:
    """What the orthogonal functions say about a pool; `sensitivity` and `at` reuse the path, nothing is refitted.

    Attributes:
        names: All candidates.
        order: Columns along the path, first chosen first.
        rows: The ranking, one row per column of `order`.
        minimum: Number of terms at the global minimum of the predicted squared error; 0 if none pays.
        estimate: Coefficients of the kept terms, transformed back exactly, in order of choice, (minimum,).
        ceiling: sigma_max^2 and its rule.
        penalty_factor: f of the predicted squared error.
        samples: Rows used, N.
        mean_square: Mean of z^2 [unit of z, squared].
        dropped: Candidates left out as (near) combinations of chosen ones: name and number of terms by then.
        exhausted: True if no candidate was left or nothing was left to explain.
        certain: True if no longer path could lower the minimum.
        forced: Number of terms kept whatever they pay.
        orthogonal_estimate: Coefficients of the orthonormal functions h, (K,).
        triangular: Upper triangular factor of the chosen columns, (K, K).
    """

    names: tuple[str, ...]
    order: tuple[int, ...]
    rows: tuple[Row, ...]
    minimum: int
    estimate: Float[np.ndarray, " n"]
    ceiling: Ceiling
    penalty_factor: float
    samples: int
    mean_square: float
    dropped: tuple[tuple[str, int], ...]
    exhausted: bool
    certain: bool
    forced: int
    orthogonal_estimate: Float[np.ndarray, " K"]
    triangular: Float[np.ndarray, "K K"]

    @property
    def selected(self) -> tuple[int, ...]:
        """Columns kept, in order of choice."""
        return self.order[: self.minimum]

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the columns kept, in order of choice."""
        return tuple(self.names[j] for j in self.selected)

    def coefficients(self, n: int) -> Float[np.ndarray, " n"]:
        """Coefficients of the first n candidates of the path when these n are the model (6.3.6-3)."""
        if not 0 <= n <= len(self.order):
            raise InputError(Fault("coefficients n", str(n), f"0 to {len(self.order)}, the length of the path"))
        if n == 0:
            return np.zeros(0)
        solved: np.ndarray = solve_triangular(self.triangular[:n, :n], self.orthogonal_estimate[:n])
        return solved

    def mean_squared_errors(self) -> Float[np.ndarray, " K+1"]:
        """Mean squared error after 0, 1, ... K terms [unit of z, squared]."""
        return np.array([self.mean_square, *(row.mse for row in self.rows)])

    def at(self, sigma_max2: float) -> Structure:
        """The structure kept along the same path under another sigma_max^2."""
        _positive("sigma_max2", sigma_max2)
        cost = self.penalty_factor * sigma_max2 / self.samples
        n, _ = _minimum(self.mean_squared_errors(), cost, self.forced, self.exhausted)
        return self._structure(n, sigma_max2)

    def sensitivity(self, sigma_max2: Sequence[float] | None = None) -> tuple[Structure, ...]:
        """How the structure changes with sigma_max^2, along the same path.

        Args:
            sigma_max2: Values to try [unit of z, squared]; None: every structure that any value can give, from
                the smallest value to the largest, each at a value inside its range.

        Returns:
            One structure per value.
        """
        if sigma_max2 is not None:
            return tuple(self.at(float(value)) for value in sigma_max2)
        mse = self.mean_squared_errors()
        n = self.forced + int(np.argmin(mse[self.forced :]))
        found = []
        while True:
            found.append(self._structure(n, None))
            fewer = np.arange(self.forced, n)
            if fewer.size == 0:
                return tuple(found)
            n = int(fewer[np.argmin((mse[fewer] - mse[n]) / (n - fewer))])

    def _structure(self, n: int, sigma_max2: float | None) -> Structure:
        mse = self.mean_squared_errors()
        fewer, more = np.arange(self.forced, n), np.arange(n + 1, mse.size)
        per_cost = self.samples / self.penalty_factor
        high = float(np.min((mse[fewer] - mse[n]) / (n - fewer), initial=np.inf)) * per_cost
        low = float(np.max((mse[n] - mse[more]) / (more - n), initial=0.0)) * per_cost
        value = _inside(low, high) if sigma_max2 is None else float(sigma_max2)
        certain = self.exhausted or value * mse.size / per_cost >= mse[n] + value * n / per_cost
        return Structure(value, n, tuple(self.names[j] for j in self.order[:n]), low, high, bool(certain))

    def with_ceiling(self, ceiling: Ceiling, penalty_factor: float | None = None) -> Selection:
        """The same path judged by another sigma_max^2 (and f)."""
        factor = self.penalty_factor if penalty_factor is None else penalty_factor
        _positive("penalty_factor", factor)
        n, certain = _minimum(
            self.mean_squared_errors(), factor * ceiling.value / self.samples, self.forced, self.exhausted
        )
        rows = []
        for row in self.rows:
            pse = row.mse + factor * ceiling.value * row.n / self.samples
            f_ratio = _f_ratio(row.dmse, row.n, self.samples, ceiling.noise_variance)
            rows.append(replace(row, pse=pse, pe=float(np.sqrt(pse)), f_ratio=f_ratio))
        return replace(
            self,
            rows=tuple(rows),
            minimum=n,
            certain=certain,
            ceiling=ceiling,
            penalty_factor=factor,
            estimate=self.coefficients(n),
        )

    def print_out(self, rows: int = 20) -> str:
        """The ranking as text, in the form of the report's print-out."""
        width = max([5, *(len(row.index) for row in self.rows[:rows])])
        head = f"{'#':>3} {'index':>{width}} {'sqrt(mse)':>10} {'dmse':>11} {'perr':>7} {'R2':>7}"
        lines = [f"{head} {'pe':>10} {'n':>3} {'F':>9}  term"]
        for r in self.rows[:rows]:
            left = f"{r.n:>3} {r.index:>{width}} {np.sqrt(r.mse):>10.3e} {r.dmse:>11.3e} {r.perr:>7.2f} {r.r2:>7.2f}"
            mark = "  <- minimum" if r.n == self.minimum else ""
            lines.append(f"{left} {r.pe:>10.3e} {r.n:>3} {r.f_ratio:>9.2f}  {r.term}{mark}")
        lines.append(f"penalty {self.penalty_factor:g} sigma_max^2 n/N, N = {self.samples}; {self.ceiling.sentence}")
        return "\n".join(lines)


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
        max_terms: Longest path; `Selection.certain` tells whether it was long enough.
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
    _positive("select penalty_factor", penalty_factor)
    if not 0.0 < drop_tolerance < 1.0:
        raise InputError(Fault("select drop_tolerance", repr(drop_tolerance), "a share between 0 and 1"))
    if max_terms < max(1, len(forced)):
        raise InputError(Fault("select max_terms", str(max_terms), "at least 1 and the number of forced columns"))
    if len(set(forced)) != len(forced) or any(not 0 <= j < p for j in forced):
        raise InputError(Fault("select forced", str(list(forced)), f"different columns from 0 to {p - 1}"))
    if indices is not None and len(indices) != p:
        raise InputError(Fault("select indices", f"{len(indices)} indices", f"one for each of the {p} columns"))
    labels = row_labels(groups, problem.used.size, "select groups")[problem.used]
    variance = group_variance(problem.z, labels)
    ceiling = noise_ceiling(rule, variance=variance, sigma_max2=sigma_max2, noise_variance=noise_variance)
    path = _greedy(problem, min(max_terms, N, p), drop_tolerance, tuple(forced))
    rows = _ranking(path, problem, indices, variance)
    K = len(path.order)
    bare = Selection(
        names=problem.names,
        order=path.order,
        rows=rows,
        minimum=0,
        estimate=np.zeros(0),
        ceiling=ceiling,
        penalty_factor=penalty_factor,
        samples=N,
        mean_square=float(np.mean(problem.z**2)),
        dropped=tuple((problem.names[j], n) for j, n in path.dropped),
        exhausted=path.exhausted,
        certain=False,
        forced=len(forced),
        orthogonal_estimate=path.a,
        triangular=path.triangular[:K, :K].copy(),
    )
    return bare.with_ceiling(ceiling)


def noise_ceiling(
    rule: str | None,
    *,
    variance: float | None = None,
    sigma_max2: float | None = None,
    noise_variance: float | None = None,
    safety: float = REPORT_SAFETY,
) -> Ceiling:
    """The sigma_max^2 of the predicted squared error (6.3.6-11, -12).

    Rules: "fixed" takes sigma_max2 as given. "smoothing" takes the noise variance that global Fourier smoothing left,
    with no safety factor. "25 sigma^2" is the report's: that variance times `safety`. "default" is the variance of the
    response about its mean, the bound when nothing is known of the noise: a model that only knows the mean errs by
    that much. The F ratio needs a sigma^2: the noise variance, or sigma_max^2/safety where none is given.

    Args:
        rule: One of the four; None picks by what is given, in the order fixed, 25 sigma^2, default.
        variance: Variance of the response about its mean, for "default".
        sigma_max2: For "fixed".
        noise_variance: For "smoothing" and "25 sigma^2".
        safety: Factor on the noise variance; the report's 25 is five standard deviations.

    Returns:
        The value and the rule in words.

    Raises:
        InputError: For an unknown rule, or one whose number is missing or not above zero.
    """
    if rule is None:
        rule = "fixed" if sigma_max2 is not None else "default" if noise_variance is None else "25 sigma^2"
    _positive("sigma_max safety", safety)
    source = {
        "fixed": (sigma_max2, 1.0, "sigma_max2", "as given"),
        "smoothing": (noise_variance, 1.0, "noise_variance", "noise variance from smoothing"),
        "25 sigma^2": (noise_variance, safety, "noise_variance", f"{safety:g} x noise variance from smoothing"),
        "default": (variance, 1.0, "the variance of z", "variance of the response about its mean"),
    }
    if rule not in source:
        raise InputError(Fault("sigma_max rule", repr(rule), "one of " + ", ".join(map(repr, source))))
    value, factor, name, words = source[rule]
    if value is None:
        raise InputError(Fault(f"sigma_max rule {rule!r}", f"no {name}", f"{name} as a number"))
    _positive(name, value)
    if noise_variance is not None:
        _positive("noise_variance", noise_variance)
    sigma_max2 = float(value) * factor
    noise = float(noise_variance) if noise_variance is not None else sigma_max2 / safety
    return Ceiling(sigma_max2, rule, noise, f"sigma_max^2 = {sigma_max2:.4g}, {words}")


def read_problem(
    X: Float[np.ndarray, "N p"], z: Float[np.ndarray, " N"], names: Sequence[str] | None, where: str
) -> Problem:
    """Check a regression; rows with a NaN in z or X are left out, infinite values refused.

    Args:
        X: Columns, (N, p).
        z: Response, (N,).
        names: Name of each column, or None.
        where: Start of each fault's place.

    Returns:
        The problem. X is not copied when no row is missing and it holds float64.

    Raises:
        InputError: With every fault found.
    """
    X, z = _numbers(X, f"{where} X", 2), _numbers(z, f"{where} z", 1)
    if X.shape[0] != z.size or X.size == 0:
        wanted = "X (N, p) and z (N,) with the same N and at least one column and row"
        raise InputError(Fault(where, f"X {X.shape} and z {z.shape}", wanted))
    p = X.shape[1]
    labels = tuple(f"x{j + 1}" for j in range(p)) if names is None else tuple(names)
    if len(labels) != p or len(set(labels)) != p:
        raise InputError(Fault(f"{where} names", f"{len(set(labels))} different names", f"{p}, one for each column"))
    missing_x = np.isnan(X)
    used = ~(np.isnan(z) | missing_x.any(axis=1))
    wanted = f"finite numbers of magnitude {_SMALLEST:g} to {_LARGEST:g} or 0, NaN where missing"
    faults = [
        Fault(
            f"{where} column {labels[j]!r}", f"{'an infinite' if np.isinf(size) else 'a'} value of {size:.3g}", wanted
        )
        for j, size in enumerate(np.maximum(np.fmax.reduce(X, axis=0), -np.fmin.reduce(X, axis=0)))
        if out_of_range(size)
    ]
    largest = float(np.maximum(np.fmax.reduce(z), -np.fmin.reduce(z)))
    if out_of_range(largest):
        infinite = "an infinite" if np.isinf(largest) else "a"
        faults.append(Fault(f"{where} z", f"{infinite} value of {largest:.3g}", wanted))
    if not used.any():
        empty = ["z"] if np.isnan(z).all() else []
        empty += [repr(labels[j]) for j in np.flatnonzero(missing_x.all(axis=0))]
        reason = f" ({', '.join(empty)} wholly missing)" if empty else ""
        faults.append(Fault(where, f"no row without a missing value{reason}", "at least one complete row"))
    if faults:
        raise InputError(faults)
    return Problem(X, z, labels, used) if used.all() else Problem(X[used], z[used], labels, used)


def out_of_range(largest: float) -> bool:
    """Whether a largest magnitude is one whose squares would leave double precision (or infinite); NaN passes."""
    return bool(largest > _LARGEST or 0.0 < largest < _SMALLEST)


def group_variance(z: Float[np.ndarray, " n"], labels: np.ndarray) -> float:
    """Mean square of z about the mean of each group [unit of z, squared]."""
    count = np.bincount(labels)
    mean = np.bincount(labels, weights=z) / np.maximum(count, 1)
    deviation = z - mean[labels]
    scale = float(np.max(np.abs(z)))
    variance = float(np.mean(deviation**2))
    return 0.0 if variance <= (8.0 * np.finfo(float).eps * scale) ** 2 else variance


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


def _minimum(mse: np.ndarray, cost: float, forced: int, exhausted: bool) -> tuple[int, bool]:
    pse = mse + cost * np.arange(mse.size)
    n = forced + int(np.argmin(pse[forced:]))
    # mse can't fall below 0, so a longer path costs at least `cost` times its length
    return n, bool(exhausted or cost * mse.size >= pse[n])


def _f_ratio(dmse: float, n: int, samples: int, noise_variance: float) -> float:
    return abs(dmse) * samples / (samples - n) / noise_variance if n < samples else np.nan


def _inside(low: float, high: float) -> float:
    if not np.isfinite(high):
        return 2.0 * low if low > 0.0 else 1.0
    return float(np.sqrt(low * high)) if low > 0.0 else high / 2.0


def row_labels(labels: Sequence[Hashable] | np.ndarray | None, rows: int, where: str) -> np.ndarray:
    """Number the labels of the rows 0, 1, ... in the order in which they first appear; all 0 if None.

    Raises:
        InputError: If there isn't one label for each row.
    """
    if labels is None:
        return np.zeros(rows, dtype=np.intp)
    if len(labels) != rows or (isinstance(labels, np.ndarray) and labels.ndim != 1):
        raise InputError(Fault(where, f"{len(labels)} labels", f"one for each of the {rows} rows"))
    seen: dict[Any, int] = {}
    return np.array([seen.setdefault(label, len(seen)) for label in labels], dtype=np.intp)


def _positive(where: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(Fault(where, repr(value), "a finite number above 0"))


def _numbers(values: Any, where: str, dimensions: int) -> np.ndarray:
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(Fault(where, "rows of unequal length", "an array of numbers")) from error
    if array.dtype.kind not in "fiub" or array.ndim != dimensions:
        got = f"an array of {array.ndim} dimensions and type {array.dtype}"
        raise InputError(Fault(where, got, f"real numbers in {dimensions} dimension(s)"))
    return np.asarray(array, dtype=np.float64)
