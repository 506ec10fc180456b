"""Rows of a campaign as Parquet: a folder with a file per replicate, written as they come, read as one table.

A row contains the results of a replicate: names, numbers and texts, nested. Its file is a table, one line per entry:

    seed   entry                                   value   text
    40000  /parameters/axial[alpha^2]/mean         0.231   0.231
    40000  /bands/cdt-3-12/swing_angle/crps        0.0011  0.0011
    40001  /error                                  null    "FloatingPointError in fit: ..."

`entry` is the JSON pointer (RFC 6901) to it, `value` its number (true is 1), `text` its JSON. All files have these
columns, so ``pandas.read_parquet(folder)`` gives all rows, complete or of a campaign that still flies.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole

Row = dict[str, Any]
_COLUMNS = (("seed", pa.int64()), ("entry", pa.string()), ("value", pa.float64()), ("text", pa.string()))
_CAMPAIGN = b"campaign"


def entries(what: Any, pointer: str = "") -> Iterator[tuple[str, Any]]:
    """JSON pointers of a row with their values, in its order.

    A list is an entry too, before those of its items; so is a dict that is empty or in a list.

    Args:
        what: The row, or a part of it.
        pointer: To that part.
    """
    if isinstance(what, dict) and what:
        for key, inner in what.items():
            yield from entries(inner, f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}")
    elif isinstance(what, list | tuple):
        yield pointer, []
        for number, inner in enumerate(what):
            if isinstance(inner, dict) and inner:
                yield f"{pointer}/{number}", {}
            yield from entries(inner, f"{pointer}/{number}")
    else:
        yield pointer, what


def row_of(pairs: Iterable[tuple[str, Any]]) -> Row:
    """The row of its `entries`."""
    row: Row = {}
    for pointer, what in pairs:
        *path, last = (key.replace("~1", "/").replace("~0", "~") for key in pointer.split("/")[1:])
        inner: Any = row
        for key in path:
            inner = inner[int(key)] if isinstance(inner, list) else inner.setdefault(key, {})
        if isinstance(inner, list):
            inner.append(what)
        else:
            inner[last] = what
    return row


def write_row(folder: Path, identity: str, row: Row) -> None:
    """Store a row, whole or not at all.

    Args:
        folder: Of the rows; made if missing.
        identity: Hash of the campaign.
        row: With its ``seed``; keys are texts.
    """
    pairs = list(entries(row))
    columns = (
        [row["seed"]] * len(pairs),
        [pointer for pointer, _ in pairs],
        [float(what) if isinstance(what, int | float) else None for _, what in pairs],
        [json.dumps(what) for _, what in pairs],
    )
    table = pa.table(list(columns), pa.schema(_COLUMNS, metadata={_CAMPAIGN: identity.encode()}))
    write_whole(folder / f"{row['seed']}.parquet", partial(pq.write_table, table))


def read_rows(folder: Path, identity: str | None = None) -> dict[int, Row]:
    """Rows of a campaign by seed; none where there is no folder.

    Args:
        folder: Of the rows.
        identity: Hash of the campaign; that of the first row where None.

    Raises:
        InputError: If files belong to another campaign or are no rows; all of them at once.
    """
    rows: dict[int, Row] = {}
    others, faults = Counter[str](), []
    for path in sorted(folder.glob("[!.]*.parquet")):
        try:
            table = pq.ParquetFile(path).read()
            found = (table.schema.metadata or {})[_CAMPAIGN].decode()
            row = row_of(zip(table["entry"].to_pylist(), map(json.loads, table["text"].to_pylist()), strict=True))
            seed = int(row["seed"])
        except (OSError, pa.ArrowException, LookupError, ValueError, TypeError) as error:
            do, says = "Remove it: its replicate is made again.", " ".join(str(error).split())
            faults.append(Fault(str(path), f"a file that is no row ({says})", "a row of a campaign", do))
        else:
            identity, rows[seed] = identity or found, row
            if found != identity:
                others[found] += 1
    for found, count in others.items():
        do, got = "Choose another --out, or remove the folder to begin anew.", f"{count} rows of campaign {found[:12]}"
        faults.append(Fault(str(folder), got, f"rows of campaign {identity or '':.12}", do))
    if faults:
        raise InputError(faults)
    return rows
