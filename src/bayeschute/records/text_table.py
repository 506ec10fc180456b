"""Tables of numbers from text and Parquet files; errors of a file are raised as faults."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.netcdf import said

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

LARGEST_FILE = 1 << 30  # bytes of text after unpacking; more is taken for a damaged file
LARGEST_TABLE = 200_000_000  # numbers in the columns wanted
SHOWN = 60  # characters of a file's own text in messages


class Table(NamedTuple):
    """Part of a file's table.

    Attributes:
        names: All columns of the file.
        frame: The columns wanted; the index counts samples from 0.
        first_row: Row of sample 0, as an editor numbers it (the header of a text file is row 1).
    """

    names: list[str]
    frame: pd.DataFrame
    first_row: int


def _unpacked(path: Path) -> bytes:
    """The bytes of a text file, unpacked if gzipped."""
    opener: Callable[[Path], Any] = gzip.open if path.name.lower().endswith(".gz") else lambda p: open(p, "rb")
    try:
        with opener(path) as file:
            data = bytes(file.read(LARGEST_FILE + 1))
    except (OSError, EOFError, zlib.error) as error:
        got = f"a file that can't be read ({said(error)})"
        raise InputError(Fault(str(path), got, "a whole, readable file", "Copy it again.")) from error
    if len(data) > LARGEST_FILE:
        raise InputError(Fault(str(path), f"more than {LARGEST_FILE} bytes", "a smaller file", "Thin the record."))
    return data


def _text(path: Path) -> str:
    """A text file's contents with plain line ends."""
    data = _unpacked(path)
    if not data.strip():
        raise InputError(Fault(str(path), "an empty file", "a header and samples"))
    if b"\0" in data:
        raise InputError(Fault(str(path), "binary data", "comma-separated text in UTF-8", "Is it another format?"))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data.count(b"\n", 0, error.start) + 1
        got = f"bytes that are not UTF-8 (first in row {row})"
        raise InputError(Fault(str(path), got, "text in UTF-8", "Save it as UTF-8.")) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _ragged(text: str, delimiter: str, path: Path) -> list[Fault]:
    """A fault where rows have more or fewer fields than the header; text with quotes is left to the parser."""
    if '"' in text:
        return []
    lines = text.split("\n")
    wanted = lines[0].count(delimiter)
    bad = [(i, n) for i, line in enumerate(lines, 1) if (n := line.count(delimiter)) != wanted and line.strip()]
    if not bad:
        return []
    got = f"{bad[0][1] + 1} fields in row {bad[0][0]} ({len(bad)} such rows)"
    advice = "Was the file cut off? Drop or mend those rows."
    return [Fault(str(path), got, f"{wanted + 1} fields as in the header", advice)]


def read_csv(path: Path, wanted: Collection[str]) -> Table:
    """Columns of a comma-, semicolon- or tab-separated file, gzipped or not; what isn't a number stays text.

    Args:
        path: The file.
        wanted: Names of columns; those that the file lacks are left out.

    Returns:
        The table; rows without any of the columns wanted (blank lines) are dropped.

    Raises:
        InputError: If the file is empty, binary, not UTF-8, cut off or no table.
    """
    import pandas as pd

    text = _text(path)
    header = text.split("\n", 1)[0]
    delimiter = max(",;\t", key=header.count)
    names = [name.strip().strip('"').strip() for name in header.split(delimiter)]
    faults = _ragged(text, delimiter, path)
    for name in dict.fromkeys(n for n in names if n in wanted and names.count(n) > 1):
        got = f"column {name[:SHOWN]!r} {names.count(name)} times"
        faults.append(Fault(f"{path} header", got, "each column once"))
    if faults:
        raise InputError(faults)
    places = [i for i, name in enumerate(names) if name in wanted]
    try:
        # The header is skipped: pandas would rename columns that it deems repeated.
        frame = pd.read_csv(
            io.StringIO(text), sep=delimiter, header=None, skiprows=1, names=list(range(len(names))), usecols=places,
            index_col=False, low_memory=False, skip_blank_lines=False, skipinitialspace=True, on_bad_lines="error",
        )  # fmt: skip
    except Exception as error:  # pandas raises many kinds on text that is no table
        got = f"text that is no table ({said(error)})"
        raise InputError(Fault(str(path), got, "rows of comma-separated values under one header")) from error
    frame.columns = pd.Index([names[i] for i in frame.columns], dtype=object)
    return Table(names, frame.loc[~frame.isna().all(axis=1)], 2)


def read_parquet(path: Path, wanted: Collection[str]) -> Table:
    """Columns of a Parquet file.

    Args:
        path: The file.
        wanted: Names of columns; those that the file lacks are left out.

    Returns:
        The table.

    Raises:
        InputError: If the file is damaged or larger than any flight.
    """
    try:
        import pyarrow.parquet as pq

        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = [str(name) for name in file.schema_arrow.names]
            columns = [name for name in dict.fromkeys(names) if name in wanted]
            if file.metadata.num_rows * max(len(columns), 1) > LARGEST_TABLE:
                got = f"{file.metadata.num_rows} rows"
                raise InputError(Fault(str(path), got, "a flight record", "Thin the record."))
            frame = file.read(columns=columns, use_threads=False).to_pandas(ignore_metadata=True)
    except InputError:
        raise
    except Exception as error:  # pyarrow raises many kinds on damaged files
        got = f"a file that can't be read ({said(error)})"
        raise InputError(Fault(str(path), got, "a Parquet file")) from error
    return Table(names, frame.reset_index(drop=True), 1)


def numbers(column: pd.Series, where: str, first_row: int) -> tuple[Array, list[Fault]]:
    """A column as numbers, NaN where it is empty.

    Args:
        column: The column; its index counts samples from 0.
        where: Place for messages.
        first_row: Row of sample 0.

    Returns:
        Values (T,) and the faults: text, infinite values, no value at all.
    """
    if not hasattr(column, "dtype"):
        return np.zeros(0), [Fault(where, "a column that occurs twice", "each column once")]
    kind = getattr(column.dtype, "kind", "O")
    if kind in "iuf":
        values = column.to_numpy(dtype=float, na_value=np.nan)
    elif kind in "bmM":
        return np.full(len(column), np.nan), [Fault(where, f"values of type {column.dtype}", "numbers")]
    else:
        values = np.array([_number(v) for v in column], dtype=float)
        bad = np.flatnonzero(np.isnan(values) & ~column.isna().to_numpy())
        if bad.size:
            row = int(column.index[bad[0]]) + first_row
            got = f"text {str(column.iloc[bad[0]])[:SHOWN]!r} in row {row} ({bad.size} such rows)"
            advice = "Mend or empty those fields."
            return values, [Fault(where, got, "numbers, or nothing where a value is missing", advice)]
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        row = int(column.index[infinite[0]]) + first_row
        got = f"an infinite value in row {row} ({infinite.size} such rows)"
        return values, [Fault(where, got, "finite numbers", "Empty those fields.")]
    if not np.isfinite(values).any():
        return values, [Fault(where, "no value at all", "at least one number", "Leave the column out of the map.")]
    return values, []


def _number(value: Any) -> float:
    """A field as a number; NaN where it is none."""
    if isinstance(value, bool | np.ndarray) or (isinstance(value, str) and "_" in value):
        return np.nan  # NumPy may take a list of one number for that number
    try:
        return float(value)
    except (TypeError, ValueError):
        return np.nan
    except OverflowError:
        return np.inf
