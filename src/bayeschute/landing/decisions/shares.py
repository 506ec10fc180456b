"""Sensitivity: shares of a variance by groups of inputs (Sobol) and by correlated parameters (Shapley).

Groups of inputs are independent of each other, so their shares are Sobol's: Saltelli's design (Comput. Phys. Commun.
181, 2010, 259) of two base samples and mixtures of them, with Jansen's estimators (1999). Parameters of a posterior
are correlated, and Sobol's shares don't hold for them; theirs are Shapley values of the variance that a linear model
explains (Lindeman, Merenda and Gold 1980; Owen and Prieur 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayeschute.core.random import stream
from bayeschute.landing.measures import IDS

Array = NDArray[np.float64]
SOURCES = dict(zip(IDS, ("parameters", "winds", "start", "gusts", "canopies", "surface"), strict=True))
"""What shares of landings are called, by what landings are made of."""
_ROUNDING = 1e-12  # of a value that never differs
_MOST_EXACT = 12  # parameters up to which all subsets are looked at
_ORDERS = 400  # random orders beyond


class Shares(NamedTuple):
    """Shares of a variance; NaN where all landings are the same.

    Attributes:
        names: Sources.
        first: Share of each source alone.
        first_error: Its standard error, by bootstrap over the design's rows.
        total: Share that would be left if all others were known: interactions counted with each of their sources.
        total_error: Its standard error.
    """

    names: tuple[str, ...]
    first: Array
    first_error: Array
    total: Array
    total_error: Array


def jansen(a: Array, b: Array, mixed: Array, seed: int = 0, resamples: int = 200) -> tuple[Array, Array, Array, Array]:
    """First and total shares with their standard errors; NaN of a function that never differs.

    A resample that never differs, as of a failure that is rare, has no shares and is left out of the errors.

    Args:
        a: Values of the first base sample (N,).
        b: Of the second (N,).
        mixed: Of samples as the first but for one source, which is the second's (sources, N).
        seed: Of the bootstrap.
        resamples: Of the bootstrap.
    """
    if np.isnan(_variance(np.concatenate([a, b]))):
        return (np.full(len(mixed), np.nan),) * 4
    rng = stream(seed, "bootstrap of shares")

    def both(pick: NDArray[np.int64] | slice) -> tuple[Array, Array]:
        variance = _variance(np.concatenate([a[pick], b[pick]]))
        first = 1.0 - 0.5 * ((b[pick] - mixed[:, pick]) ** 2).mean(axis=1) / variance
        return first, 0.5 * ((a[pick] - mixed[:, pick]) ** 2).mean(axis=1) / variance

    first, total = both(slice(None))
    again = [both(rng.integers(0, a.size, a.size)) for _ in range(resamples)]
    errors = np.std([one for one in again if np.isfinite(one[0]).all()], axis=0)
    return first, errors[0], total, errors[1]


def _variance(values: Array) -> float:
    """NaN if they differ by no more than they are rounded, or are none."""
    if not values.size:
        return np.nan
    found = float(np.var(values))
    return found if found > (_ROUNDING * np.abs(values).max()) ** 2 else np.nan


def design(draws: int, samples: int, varied: Sequence[str] = IDS) -> NDArray[np.int64]:
    """Landings of Saltelli's design, groups being what landings are made of: ids ((groups + 2) N, 6).

    Base samples are landings of their own in all six numbers. Draws are taken in turn by both samples, those of the
    second so many places on, one more in every round, that no landing meets its own draw again (of two or more draws).

    Args:
        draws: Of the parameters.
        samples: N.
        varied: Groups whose shares are wanted, of `measures.IDS`.
    """
    each = np.arange(samples)
    apart = 1 + (draws // 2 + each // draws) % max(draws - 1, 1)
    a = np.stack([each % draws, *(each,) * (len(IDS) - 1)], axis=1)
    b = np.stack([(each + apart) % draws, *(each + samples,) * (len(IDS) - 1)], axis=1)
    blocks = [a, b]
    for i in map(IDS.index, varied):
        point = a.copy()
        point[:, i] = b[:, i]
        blocks.append(point)
    return np.concatenate(blocks)


def by_groups(values: ArrayLike, varied: Sequence[str] = IDS) -> Shares:
    """Shares by what landings are made of, from values of the landings of `design`.

    Rows of the design in which a landing failed are left out; groups as of `design`.
    """
    blocks = np.asarray(values, float).reshape(len(varied) + 2, -1)
    blocks = blocks[:, np.isfinite(blocks).all(axis=0)]
    first, e1, total, e2 = jansen(blocks[0], blocks[1], blocks[2:])
    return Shares(tuple(SOURCES[name] for name in varied), first, e1, total, e2)


def shapley(inputs: Array, values: ArrayLike, names: Sequence[str]) -> dict[str, float]:
    """Shares of the variance of values that correlated inputs explain linearly, in Shapley's sense.

    Args:
        inputs: (N, P).
        values: (N,).
        names: Of the inputs.

    Returns:
        Share by name; they sum to the squared multiple correlation, corrected for the number of inputs. NaN of values
        that never differ.
    """
    y = np.asarray(values, float)
    if np.isnan(_variance(y)):
        return dict.fromkeys(names, float("nan"))
    x = (inputs - inputs.mean(axis=0)) / np.maximum(inputs.std(axis=0), 1e-300)
    y = y - y.mean()
    gram, cross, power = x.T @ x / y.size, x.T @ y / y.size, float(y @ y) / y.size
    gram += 1e-10 * np.eye(len(gram))
    known: dict[tuple[int, ...], float] = {(): 0.0}

    def explained(some: tuple[int, ...]) -> float:
        if some not in known:
            pick = list(some)
            known[some] = float(cross[pick] @ np.linalg.solve(gram[np.ix_(pick, pick)], cross[pick])) / power
        return known[some]

    count = len(names)
    share = np.zeros(count)
    if count <= _MOST_EXACT:
        for i in range(count):
            others = [j for j in range(count) if j != i]
            for size in range(count):
                weight = 1.0 / (count * comb(count - 1, size))
                for some in combinations(others, size):
                    share[i] += weight * (explained(tuple(sorted((*some, i)))) - explained(some))
    else:
        rng = stream(0, "orders of Shapley shares")
        for _ in range(_ORDERS):
            order = rng.permutation(count)
            for k, i in enumerate(order):
                before = tuple(sorted(order[:k].tolist()))
                share[i] += (explained(tuple(sorted((*before, int(i))))) - explained(before)) / _ORDERS
    whole = explained(tuple(range(count)))
    fair = 1.0 - (1.0 - whole) * (y.size - 1.0) / max(y.size - count - 1.0, 1.0)
    scale = max(fair, 0.0) / whole if whole > 0.0 else 0.0
    return dict(zip(names, (share * scale).tolist(), strict=True))
