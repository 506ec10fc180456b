"""Structure selection over a pool: ranking, predicted squared error, the structure for each noise ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.noise_ceiling import Ceiling
from bayeschute.regression.problem import positive


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
        positive("sigma_max2", sigma_max2)
        cost = self.penalty_factor * sigma_max2 / self.samples
        n, _ = least_pse(self.mean_squared_errors(), cost, self.forced, self.exhausted)
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
        positive("penalty_factor", factor)
        n, certain = least_pse(
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


def least_pse(mse: np.ndarray, cost: float, forced: int, exhausted: bool) -> tuple[int, bool]:
    """Number of terms at the global minimum of mse + cost n, and whether no longer path could lower it.

    Args:
        mse: Mean squared error after 0, 1, ... K terms [unit of z, squared].
        cost: f sigma_max^2/N [unit of z, squared].
        forced: Least number of terms.
        exhausted: Whether the path can't be longer.
    """
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
