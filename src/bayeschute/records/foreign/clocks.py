"""Clocks of records: stamps of date and time, GPS weeks, clocks that begin anew, rows out of order or repeated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault
from bayeschute.records.foreign.conventions import Conventions

Array = NDArray[np.float64]

ISO = "iso"  # the unit of a column of stamps
_WEEK = 604800.0  # [s]


def of_stamps(column: Any, where: str, first_row: int) -> tuple[Array, list[Fault]]:
    """Seconds since the first stamp, of stamps such as ``2024-08-31T13:09:23.5Z`` (T,); without a zone they are UTC.

    Args:
        column: Of a data frame; its index counts rows.
        where: Place for messages.
        first_row: Row of sample 0 in the file.
    """
    import pandas as pd

    stamps = pd.to_datetime(column.astype(str), utc=True, errors="coerce", format="ISO8601")
    bad = np.flatnonzero(stamps.isna().to_numpy())
    if bad.size:
        text = str(column.iloc[bad[0]])[:60]
        got = f"{text!r} in row {column.index[bad[0]] + first_row} ({bad.size} such)"
        wanted = "date and time as ISO 8601 has it, such as 2024-08-31T13:09:23.5Z"
        return np.full(len(column), np.nan), [Fault(where, got, wanted)]
    since = stamps - stamps.iloc[0]
    return np.asarray(since.dt.total_seconds().to_numpy(), np.float64), []


def continued(time: Array, week: Array | None, said: Conventions) -> Array:
    """A clock that goes on where the record's begins anew (T,) [s].

    Args:
        time: As recorded [s].
        week: GPS week of every row; None: not recorded.
        said: Conventions; `clock_wraps` is the length of the clock's round.
    """
    if week is not None:
        seen = week[np.isfinite(week)]
        return time + _WEEK * (week - (seen[0] if seen.size else 0.0))
    if said.clock_wraps is None or time.size < 2:
        return time
    back = np.concatenate([[False], np.diff(time) < -0.5 * said.clock_wraps])
    return np.asarray(time + said.clock_wraps * np.cumsum(back))


def in_order(found: Mapping[str, Array], rows: Array, said: Conventions) -> tuple[dict[str, Array], Array, int]:
    """Columns in the order of time, one row for each time.

    Args:
        found: Columns by key, ``time`` among them.
        rows: Row of every sample in its file.
        said: Whether rows are sorted, and which of several of one time is kept.

    Returns:
        Columns, rows, and how many rows were merged.
    """
    made, time = dict(found), found["time"]
    if said.sort_times and np.isfinite(time).all():
        order = np.argsort(time, kind="stable")
        made, rows = {key: x[order] for key, x in made.items()}, rows[order]
        time = made["time"]
    step = np.diff(time)
    if said.repeated_times is None or not np.isfinite(time).all() or (step < 0.0).any() or (step > 0.0).all():
        return made, rows, 0
    first = np.concatenate([[True], step > 0.0])
    group, count = np.cumsum(first) - 1, int(first.sum())
    if said.repeated_times == "mean":
        for key, x in made.items():
            seen = np.isfinite(x)
            total = np.bincount(group, np.where(seen, x, 0.0), count)
            number = np.bincount(group, seen.astype(float), count)
            made[key] = np.where(number > 0.0, total / np.maximum(number, 1.0), np.nan)
        return made, rows[first], int(time.size - count)
    kept = first if said.repeated_times == "first" else np.concatenate([first[1:], [True]])
    return {key: x[kept] for key, x in made.items()}, rows[kept], int(time.size - count)
