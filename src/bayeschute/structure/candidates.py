"""Pools of candidate terms: all products of explanatory variables up to a total order (report, 6.3.6 and 7.3-1).

Splines enter as additional variables. Columns are computed one at a time, so that a large pool needs memory only for
the columns requested.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb

import numpy as np
from jaxtyping import Float, Int

from bayeschute.core.errors import Fault, InputError

_MOST = 100_000


@dataclass(frozen=True)
class Pool:
    """Candidate terms of a regression.

    Attributes:
        variables: Names of the explanatory variables; number 1 is the last digit of an index.
        values: Their values, (N, n).
        exponents: Power of each variable in each product, (p, n).
        extra_names: Names of further terms.
        extra_values: Their values, (N, m).
    """

    variables: tuple[str, ...]
    values: Float[np.ndarray, "N n"]
    exponents: Int[np.ndarray, "p n"]
    extra_names: tuple[str, ...]
    extra_values: Float[np.ndarray, "N m"]

    def __len__(self) -> int:
        return len(self.exponents) + len(self.extra_names)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each candidate, such as ``alpha^2*q``; ``1`` for the constant."""
        return tuple(product_name(self.variables, row) for row in self.exponents) + self.extra_names

    @property
    def indices(self) -> tuple[str, ...]:
        """The report's decimal index of each candidate; ``u1, u2, ...`` for further terms."""
        products = tuple(decimal_index(row) for row in self.exponents)
        return products + tuple(f"u{k + 1}" for k in range(len(self.extra_names)))

    def column(self, j: int) -> Float[np.ndarray, " N"]:
        """Values of candidate j (from 0)."""
        products = len(self.exponents)
        if not 0 <= j < len(self):
            raise InputError(Fault("pool column", str(j), f"0 to {len(self) - 1}"))
        if j >= products:
            return np.array(self.extra_values[:, j - products])
        column = np.ones(self.values.shape[0])
        for i in np.flatnonzero(self.exponents[j]):
            power = int(self.exponents[j, i])
            column *= self.values[:, i] if power == 1 else self.values[:, i] ** power
        return column

    def columns(self) -> Iterator[tuple[str, Float[np.ndarray, " N"]]]:
        """Name and values of each candidate, one at a time."""
        for j, name in enumerate(self.names):
            yield name, self.column(j)

    def matrix(self, columns: Sequence[int] | None = None) -> Float[np.ndarray, "N k"]:
        """Values of all candidates, or of those requested, as columns (column-major)."""
        chosen = range(len(self)) if columns is None else columns
        out = np.empty((self.values.shape[0], len(chosen)), order="F")
        for k, j in enumerate(chosen):
            out[:, k] = self.column(int(j))
        return out


def product_pool(
    variables: Mapping[str, Float[np.ndarray, " N"]],
    order: int,
    *,
    extra: Mapping[str, Float[np.ndarray, " N"]] | None = None,
    constant: bool = True,
    limit: int = _MOST,
) -> Pool:
    """All products of the variables up to a total order, and further terms.

    Fourteen variables to order 2 give the report's 120 candidates. Order 0 holds the constant only.

    Args:
        variables: Values of each explanatory variable, by name, in the order of the index.
        order: Highest total order.
        extra: Further terms by name.
        constant: Whether the constant 1 is a candidate.
        limit: Most candidates allowed.

    Returns:
        The pool, products by rising total order first.

    Raises:
        InputError: For no variables, unequal lengths, a name used twice, a bad order, or more terms than `limit`.
    """
    names, extra = tuple(variables), dict(extra or {})
    if not names and not extra:
        raise InputError(Fault("pool variables", "none", "at least one variable or term"))
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 0:
        raise InputError(Fault("pool order", repr(order), "a whole number from 0"))
    count = comb(len(names) + int(order), int(order)) + len(extra)
    if count > limit:
        did = "Lower the order or name fewer variables."
        raise InputError(Fault("pool", f"{count} candidates", f"at most {limit}", did))
    columns = {**{n: _column(n, v) for n, v in variables.items()}, **{n: _column(n, v) for n, v in extra.items()}}
    lengths = {column.size for column in columns.values()}
    if len(lengths) != 1 or len(columns) != len(names) + len(extra):
        got = f"lengths {sorted(lengths)}" if len(lengths) != 1 else "a term named like a variable"
        raise InputError(Fault("pool", got, "columns of one length, each name once"))
    exponents = exponent_tuples(len(names), int(order), constant=constant)
    taken = {product_name(names, row) for row in exponents} & set(extra)
    if taken:
        raise InputError(Fault("pool terms", f"{sorted(taken)} twice", "terms that the products don't hold already"))
    N = lengths.pop()
    stacked = np.stack([columns[n] for n in names], axis=1) if names else np.empty((N, 0))
    further = np.stack([columns[n] for n in extra], axis=1) if extra else np.empty((N, 0))
    return Pool(names, stacked, exponents, tuple(extra), further)


def spline(
    values: Float[np.ndarray, " N"], knot: float, *, side: str = "above", power: int = 1
) -> Float[np.ndarray, " N"]:
    """One-sided spline (7.3-2, 7.3-5): ``(x - k)_+^m`` above the knot, ``(k - x)_+^m`` below it.

    Args:
        values: x.
        knot: k, in the unit of x.
        side: ``"above"`` or ``"below"``: where the spline isn't zero.
        power: m >= 0; 0 is a step.

    Returns:
        The spline, NaN where x is.

    Raises:
        InputError: For another side, a negative power or a knot that isn't a number.
    """
    if side not in ("above", "below"):
        raise InputError(Fault("spline side", repr(side), "'above' or 'below'"))
    if not np.isfinite(knot) or power < 0:
        raise InputError(Fault("spline", f"knot {knot!r}, power {power!r}", "a finite knot and a power from 0"))
    x = np.asarray(values, dtype=np.float64)
    excess = x - knot if side == "above" else knot - x
    if power == 0:
        return np.where(np.isnan(excess), np.nan, np.where(excess > 0.0, 1.0, 0.0))
    return np.asarray(np.maximum(excess, 0.0) ** power)


def exponent_tuples(variables: int, order: int, *, constant: bool = True) -> Int[np.ndarray, "p n"]:
    """Powers of all products up to a total order, by rising order; (n + order choose order) rows."""
    rows = [
        np.bincount(np.array(chosen, dtype=np.intp), minlength=variables)
        for total in range(0 if constant else 1, order + 1)
        for chosen in combinations_with_replacement(range(variables), total)
    ]
    return np.array(rows, dtype=np.intp).reshape(len(rows), variables)


def decimal_index(exponents: Sequence[int] | np.ndarray) -> str:
    """The report's index: one digit per variable, variable 1 last, no leading zeros; a power above 9 in brackets."""
    digits = "".join(str(int(e)) if e < 10 else f"({int(e)})" for e in reversed(list(exponents)))
    return digits.lstrip("0") or "0"


def product_name(variables: Sequence[str], exponents: Sequence[int] | np.ndarray) -> str:
    """Name of a product, such as ``alpha^2*q``; ``1`` for the constant."""
    factors = [v if e == 1 else f"{v}^{int(e)}" for v, e in zip(variables, exponents, strict=True) if e]
    return "*".join(factors) or "1"


def _column(name: str, values: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    column = np.asarray(values)
    if column.ndim != 1 or column.dtype.kind not in "fiub" or not name:
        got = f"shape {column.shape}, type {column.dtype}"
        raise InputError(Fault(f"pool variable {name!r}", got, "a name and real numbers in one dimension"))
    return column.astype(np.float64)
