"""Scores of 90 % bands against histories of a flight: what they hold, how wide they are, and what they are worth.

Definitions are those of the score program beside the flights: samples are those of the history inside the predicted
span, the band is interpolated between its own times. The weighted interval score of a median m and a 90 % band, in the
unit of the quantity, is (|m - y|/2 + 0.05 I)/1.5, with I the band's width plus twenty times how far y lies outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVELS = (0.05, 0.5, 0.95)
_TAIL = 0.05  # probability on either side of the band


class History(NamedTuple):
    """A quantity along a flight: times [s] and values, NaN where unknown."""

    time: Array
    values: Array


class Score(NamedTuple):
    """What a band is worth; means over samples.

    Attributes:
        samples: How many.
        held: Share inside the band.
        below: Share under it.
        above: Share over it.
        width: Of the band [unit of the quantity].
        bias: Of the median [unit of the quantity].
        wis: Weighted interval score [unit of the quantity].
    """

    samples: int
    held: float
    below: float
    above: float
    width: float
    bias: float
    wis: float


def inside(time: Array, band: Array, history: History) -> tuple[Array, Array, Array]:
    """A history's samples inside the span of a band: their times, values, and the band there (3, N)."""
    known = np.isfinite(band).all(axis=0)
    time, band = time[known], band[:, known]
    within = (history.time >= time[0]) & (history.time <= time[-1]) & np.isfinite(history.values)
    at = history.time[within]
    return at, history.values[within], np.stack([np.interp(at, time, row) for row in band])


def score(time: Array, band: Array, histories: Sequence[History]) -> Score:
    """A band against one or several histories of the same flight, pooled over samples.

    Args:
        time: Of the band (T,) [s].
        band: Its 5, 50 and 95 % quantiles (3, T).
        histories: At least one of which has a sample inside the span.
    """
    parts = [inside(time, band, history)[1:] for history in histories]
    y, (low, middle, high) = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts], axis=1)
    under, over = np.maximum(low - y, 0.0), np.maximum(y - high, 0.0)
    interval = high - low + (under + over) / _TAIL
    wis = (0.5 * np.abs(y - middle) + _TAIL * interval) / 1.5
    below, above = float(np.mean(under > 0.0)), float(np.mean(over > 0.0))
    held = float(np.mean((under == 0.0) & (over == 0.0)))
    return Score(y.size, held, below, above, *(float(np.mean(x)) for x in (high - low, middle - y, wis)))


def constant(levels: Array, time: Array) -> Array:
    """A band that is the same at all times (3, T)."""
    return np.repeat(np.asarray(levels, float)[:, None], np.size(time), axis=1)


def width_over_spread(time: Array, band: Array, histories: Sequence[History]) -> float:
    """Mean width of a band over that of the histories' own 5 to 95 %, where all of them are known."""
    at, _, there = inside(time, band, histories[0])
    rows = np.stack([np.interp(at, h.time, h.values, left=np.nan, right=np.nan) for h in histories])
    known = np.isfinite(rows).all(axis=0)
    low, high = np.quantile(rows[:, known], [LEVELS[0], LEVELS[-1]], axis=0)
    return float(np.mean(there[2, known] - there[0, known]) / np.mean(high - low))
