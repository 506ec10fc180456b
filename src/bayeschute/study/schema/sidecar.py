"""Sidecar files: tables of numbers next to a study or a vehicle, read and validated."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.units import factor_to_si
from bayeschute.study.schema.reading.strict import refuse

if TYPE_CHECKING:
    from bayeschute.records.text_table import Table

Array = NDArray[np.float64]

MOST_ROWS = 100_000
MONTH = "month"
"""Unit of a column of months: whole numbers from 1 to 12, or dates of which the month is taken."""
DATA, DATA_VARIABLE = "${DATA}", "BAYESCHUTE_DATA"


def data_folder(given: Path | str | None = None) -> str:
    """The folder that replaces ``${DATA}``, absolute: given, or in the environment; empty where it is in neither."""
    found = os.environ.get(DATA_VARIABLE, "") if given is None else str(given)
    return os.path.abspath(found) if found else ""


def context(folder: Path, data: Path | str | None = None) -> dict[str, str]:
    """Context for finding sidecar files: the folder of the file, and the folder that replaces ``${DATA}``."""
    return {"folder": str(folder), "data": data_folder(data)}


class Wanted(NamedTuple):
    """A column that is wanted: its name, its unit there, the SI unit it comes out in, whether it may be missing."""

    column: str
    unit: str
    si: str
    optional: bool = False


def read_beside(name: str, wanted: Mapping[str, Wanted], info: ValidationInfo) -> dict[str, Array]:
    """Columns of a comma-separated file, in SI.

    Args:
        name: Path of the file from the folder of the one that names it.
        wanted: Columns by the name to return.
        info: Of pydantic; its context is `context`.

    Returns:
        Columns (T,) each; optional ones that are missing are left out.

    Raises:
        PydanticCustomError: If the file isn't there, can't be read, lacks a column or a value.
    """
    from bayeschute.records.text_table import read_csv

    path = _path(name, info.context or {})
    try:
        table = read_csv(path, {spec.column for spec in wanted.values()})
    except InputError as error:
        refuse_all(error.faults)
    if not 1 <= len(table.frame) <= MOST_ROWS:
        refuse(f"1 to {MOST_ROWS} rows", f"{len(table.frame)} rows in {path}")
    found: dict[str, Array] = {}
    faults: list[Fault] = []
    for key, spec in wanted.items():
        where = f"{path} column {spec.column!r}"
        if spec.column in table.names:
            values, wrong = (_months if spec.si == MONTH else _complete)(table, spec.column, where)
            faults += wrong
            if spec.si == MONTH:
                found[key] = values
                continue
            scale, zero = factor_to_si(spec.unit, spec.si)
            with np.errstate(over="ignore"):
                found[key] = scale * values + zero
            if not wrong and np.isinf(found[key]).any():
                got = f"a value too large to convert from {spec.unit} to {spec.si}"
                faults.append(Fault(where, got, "values that can be true", "Is the unit right?"))
        elif not spec.optional:
            faults.append(Fault(where, f"no such column among {', '.join(table.names)[:200]}", "that column"))
    if faults:
        refuse_all(faults)
    return found


def _path(name: str, given: Mapping[str, Any]) -> Path:
    path = Path(os.path.normpath(Path(given.get("folder", ".")) / name.replace(DATA, given.get("data") or DATA)))
    try:
        there = path.is_file()
    except (OSError, ValueError):  # a name too long, or with a null byte
        there = False
    if not there:
        refuse("a file of comma-separated values that exists", f"no such file {str(path)[:200]!r}")
    return path


def _complete(table: Table, column: str, where: str) -> tuple[Array, list[Fault]]:
    """A column without gaps, and its faults."""
    from bayeschute.records.text_table import numbers

    values, wrong = numbers(table.frame[column], where, table.first_row)
    missing = np.flatnonzero(~np.isfinite(values))
    if not wrong and missing.size:
        row = int(table.frame.index[missing[0]]) + table.first_row
        wrong = [Fault(where, f"no number in row {row} ({missing.size} such rows)", "a number in every row")]
    return values, wrong


def _months(table: Table, column: str, where: str) -> tuple[Array, list[Fault]]:
    """Months of a column of numbers from 1 to 12, or of dates such as 2024-06-30 or 20240630, and its faults."""
    import pandas as pd

    text = pd.Series([re.sub(r"\.0$", "", str(value).strip()) for value in table.frame[column]], dtype=object)
    plain = text.str.fullmatch(r"0?[1-9]|1[0-2]", flags=re.ASCII)
    dates = pd.to_datetime(text.where(~plain), utc=True, errors="coerce", format="ISO8601").dt.month
    dated = text.str.match(r"\d{4}-\d\d|\d{8}(?!\d)", flags=re.ASCII)  # neither a lone year nor a month without one
    months = pd.to_numeric(text.where(plain)).fillna(dates.where(dated)).to_numpy(float)
    bad = np.flatnonzero(np.isnan(months))
    if bad.size:
        row = int(table.frame.index[bad[0]]) + table.first_row
        got = f"{text[bad[0]][:60]!r} in row {row} ({bad.size} such rows)"
        return months, [Fault(where, got, "months from 1 to 12, or dates such as 2024-06-30")]
    return months, []


def refuse_all(faults: Sequence[Fault]) -> NoReturn:
    """Refuse a value with all faults of its file in one message, which gives their locations."""
    got = "; ".join(f"{fault.where}: {fault.got}" for fault in faults[:5])
    refuse("; ".join(dict.fromkeys(fault.wanted for fault in faults[:5])), got[:600], faults[0].do)
