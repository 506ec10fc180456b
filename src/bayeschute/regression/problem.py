"""A regression problem as given: validated, rows with missing values dropped, labels of rows numbered."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from bayeschute.core.errors import Fault, InputError

_SMALLEST, _LARGEST = 1e-60, 1e60


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
    rounding = 8.0 * np.finfo(float).eps * np.sqrt(np.max(count)) * scale  # of a mean of so many rows
    return 0.0 if variance <= rounding**2 else variance


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


def positive(where: str, value: float) -> None:
    """Refuse a number that isn't finite and above 0."""
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
