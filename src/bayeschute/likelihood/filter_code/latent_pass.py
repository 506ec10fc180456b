"""Latent states along a record by machine code: ``x_t = F x_(t-1) + d_t``."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.emit import Program
from bayeschute.compiler.machine import compiled
from bayeschute.likelihood.filter_code.rows import RowCode, padded, parts

Array = NDArray[np.float64]


def latent_states(transition: Array, driven: Array) -> Array:
    """States (T, L, M) that a transition (L, L) leads through, driven by (T, L, M); the first are driven alone."""
    samples, size, columns = driven.shape
    if not driven.size:
        return np.zeros_like(driven)
    found = []
    for first, count in parts(padded(columns)):
        one = np.ascontiguousarray(driven[:, :, first : first + count], float)
        states = np.empty_like(one)
        run = compiled(latent_pass(size, one.shape[2]))
        run(np.ascontiguousarray(transition, float), one, states, samples)
        found.append(states)
    return np.concatenate(found, axis=2)


@cache
def latent_pass(size: int, columns: int) -> Program:
    """Latent states of M columns.

    Arguments of the function: ``transition`` (L, L); ``driven`` (T, L, M); the result ``states`` (T, L, M); then the
    number of samples.

    Args:
        size: Number of latent states, L.
        columns: M.
    """
    code = RowCode()
    with code.loop("%samples") as t:
        driven, states = (code.row_of(name, t, size * columns) for name in ("%driven", "%states"))
        for i in range(size):
            code.put(code.read(code.address(driven, i * columns), columns), code.address(states, i * columns), columns)
        with code.loop(code.least(t, "1")):  # not at the first sample
            before = code.address(states, -size * columns)
            for i in range(size):
                at = code.address(states, i * columns)
                row = code.read(at, columns)
                row = code.gathered(row, code.address("%transition", i * size), before, size, columns, columns)
                code.put(row, at, columns)
    return code.program("latent", ("transition", "driven", "states"), ("samples",), 0)
