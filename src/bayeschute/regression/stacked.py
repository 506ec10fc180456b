"""Several time series as one regression: vector components, canopies, records, flights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from bayeschute.core.errors import Fault, InputError


class Stack(NamedTuple):
    """A regression with its rows sorted into time series.

    Attributes:
        X: Regressors, (N, p).
        z: Response, (N,).
        blocks: Time series of each row.
        groups: Label of each row; series that share it are simultaneous.
        components: Which vector component each row is.
    """

    X: Float[np.ndarray, "N p"]
    z: Float[np.ndarray, " N"]
    blocks: Int[np.ndarray, " N"]
    groups: Int[np.ndarray, " N"]
    components: Int[np.ndarray, " N"]


def stack_components(X: Float[np.ndarray, "T c p"], z: Float[np.ndarray, "T c"]) -> Stack:
    """A vector regression as one regression: components one after the other, simultaneous.

    Args:
        X: Regressors of each component, (T, c, p).
        z: Response, (T, c).

    Returns:
        The stack: one series per component, all in one group.

    Raises:
        InputError: For shapes that don't fit.
    """
    X, z = np.asarray(X, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if X.ndim != 3 or X.shape[:2] != z.shape:
        raise InputError(Fault("stack", f"X {X.shape}, z {z.shape}", "X (T, c, p) and z (T, c)"))
    T, c, p = X.shape
    which = np.repeat(np.arange(c), T)
    rows = np.ascontiguousarray(np.swapaxes(X, 0, 1)).reshape(T * c, p)
    return Stack(rows, z.T.reshape(T * c), which, np.zeros(T * c, dtype=np.intp), which)


def stack_records(records: Sequence[Stack | tuple[np.ndarray, np.ndarray]]) -> Stack:
    """Several records, canopies or flights as one regression; their series stay apart.

    Args:
        records: Stacks, or pairs X (N, p), z (N,) of one series each.

    Returns:
        The stack.

    Raises:
        InputError: For no records, or unequal numbers of columns.
    """
    parts = [r if isinstance(r, Stack) else _single(*r) for r in records]
    if len({part.X.shape[1] for part in parts}) != 1:
        got = f"records with {[part.X.shape[1] for part in parts]} columns"
        raise InputError(Fault("stack", got, "at least one record, all with the same columns"))
    blocks, groups, next_block, next_group = [], [], 0, 0
    for part in parts:
        blocks.append(part.blocks + next_block)
        groups.append(part.groups + next_group)
        next_block = int(blocks[-1].max(initial=next_block - 1)) + 1
        next_group = int(groups[-1].max(initial=next_group - 1)) + 1
    return Stack(
        np.concatenate([part.X for part in parts]),
        np.concatenate([part.z for part in parts]),
        np.concatenate(blocks),
        np.concatenate(groups),
        np.concatenate([part.components for part in parts]),
    )


def _single(X: np.ndarray, z: np.ndarray) -> Stack:
    X, z = np.asarray(X, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if X.ndim != 2 or z.shape != X.shape[:1]:
        raise InputError(Fault("stack", f"X {X.shape}, z {z.shape}", "X (N, p) and z (N,)"))
    zeros = np.zeros(z.size, dtype=np.intp)
    return Stack(X, z, zeros, zeros, zeros)
