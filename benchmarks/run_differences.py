"""Where do two folders of runs differ? Every array, number and text of all their files, to the last bit.

    python benchmarks/run_differences.py ONE OTHER [--json]

A line for each difference, then their number; the exit code is 1 where there is any. What is left out stands in
`LEFT_OUT` and `TIMES`, with the reason.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import pandas as pd
import xarray as xr
from command import parser_of

LEFT_OUT = {"log.txt": "says what was done when; a run that was stopped has done more"}
"""Files that aren't compared, and why."""
TIMES = {
    "fit/facts.json": ("wall/*",),  # seconds that parts of the work took
    "summary.json": (
        "sampling/wall/*",
        "sampling/wall_s",
        "sampling/min_ess_per_s",
    ),  # those, and what is divided by them
    "posterior.nc": ("*@created_at",),  # when ArviZ made the group
    "posterior.emcee.nc": ("*@created_at",),
}
"""Values that aren't compared, by file and place: they say when something was done, or how long it took."""
TIMED_ROWS = re.compile(r'<tr><td class="text ">(?:wall time|wall,|smallest effective sample size per second)[^\n]*')
"""Rows of the report that show the same."""


def main() -> None:
    """Print what differs; with ``--json`` a list of it in place of lines."""
    parser = parser_of(__doc__)
    parser.add_argument("runs", nargs=2, type=Path, metavar="RUN", help="folder of a finished run")
    given = parser.parse_args()
    for folder in given.runs:
        if not (folder / "summary.json").is_file():
            parser.error(f"{folder} has no summary.json: wanted the folder of a finished run")
    found = list(differences(*given.runs))
    print(json.dumps(found) if given.json else "\n".join([*found, f"{len(found)} differences"]))
    sys.exit(1 if found else 0)


def differences(one: Path, other: Path, partial: bool = False) -> Iterator[str]:
    """What differs, a line each: file, place in it, values.

    Args:
        one: Folder of a finished run.
        other: Of another.
        partial: Whether files may be missing in the other folder, or be there that the first has not; those that can't
            be read are told nevertheless.
    """
    names = [sorted(_files(folder)) for folder in (one, other)]
    if not partial:
        yield from (f"{name}: missing" for name in names[0] if name not in names[1])
        yield from (f"{name}: not in the reference" for name in names[1] if name not in names[0])
    for name in names[1]:
        try:
            if name not in names[0]:
                _content(other / name)
            elif name not in LEFT_OUT:
                yield from (f"{name}: {line}" for line in _of_files(one / name, other / name, TIMES.get(name, ())))
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            yield f"{name}: can't be read: {type(error).__name__}: {error}"


def unfinished(folder: Path) -> list[str]:
    """Files that were being written, and remain."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob(".*.part*"))


def _files(folder: Path) -> Iterator[str]:
    """Paths in a folder, without those that were being written."""
    parts = {*unfinished(folder)}
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and name not in parts:
            yield name


def _content(path: Path) -> dict[str, Any]:
    """All that a file holds, by place: arrays, numbers, texts."""
    match path.suffix:
        case ".nc":
            return _of_tree(path)
        case ".npz":
            with np.load(path, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
        case ".parquet":
            table = pd.read_parquet(path)
            return {"columns": [*map(str, table.columns)]} | {str(name): table[name].to_numpy() for name in table}
        case ".json":
            return dict(_leaves(json.loads(path.read_text(encoding="utf-8"))))
        case ".html":
            text = path.read_text(encoding="utf-8")
            if "</html>" not in text:
                raise ValueError("its end is missing")
            return dict(enumerate(TIMED_ROWS.sub("", text).splitlines(), 1))  # type: ignore[arg-type]
        case _:
            return {"bytes": path.read_bytes()}


def _of_tree(path: Path) -> dict[str, Any]:
    """Groups of a NetCDF file: variables with their dimensions, coordinates and attributes as they lie there."""
    made: dict[str, Any] = {}
    with xr.open_datatree(path, engine="h5netcdf", decode_cf=False) as tree:
        for node in tree.subtree:
            made |= {f"{node.path}@{name}": value for name, value in node.attrs.items()}
            for name, variable in node.to_dataset(inherit=False).variables.items():
                place = f"{node.path}/{name}".replace("//", "/")
                made |= {place: variable.to_numpy(), f"{place} dimensions": list(variable.dims)}
                made |= {f"{place}@{key}": value for key, value in variable.attrs.items()}
    return made


def _leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Plain values of JSON by their path; empty lists and tables are values as well."""
    inside = value if isinstance(value, dict) else dict(enumerate(value)) if isinstance(value, list) else {}
    if not inside:
        yield at, value
    for key, one in inside.items():
        yield from _leaves(one, f"{at}/{key}" if at else str(key))


def _of_files(one: Path, other: Path, times: tuple[str, ...]) -> Iterator[str]:
    """What differs between two files, but for times."""
    before, after = (_content(path) for path in (one, other))
    for place in dict.fromkeys([*before, *after]):
        if any(fnmatchcase(str(place), pattern) for pattern in times):
            continue
        if place not in before or place not in after:
            yield f"{place}: {'not in the reference' if place in after else 'missing'}"
        elif words := _unlike(before[place], after[place]):
            yield f"{place}: {words}"


def _unlike(one: Any, other: Any) -> str:
    """How two values differ in kind, shape or any bit; empty where they do not."""
    if isinstance(one, str) and isinstance(other, str):
        return "" if one == other else f"{one[:60]!r}, here {other[:60]!r}"
    first, second = np.asarray(one), np.asarray(other)
    if first.dtype != second.dtype or first.shape != second.shape:
        return f"{first.dtype} {list(first.shape)}, here {second.dtype} {list(second.shape)}"
    if first.dtype.hasobject:
        alike = np.array([repr(a) == repr(b) for a, b in zip(first.flat, second.flat, strict=True)], bool)
    else:
        bits = [np.ascontiguousarray(x).reshape(-1, 1).view(np.uint8) for x in (first, second) if x.itemsize]
        alike = (bits[0] == bits[1]).all(axis=1) if bits else np.ones(first.size, bool)
    if alike.all():
        return ""
    k = int(np.argmin(alike))
    values = [repr(x.reshape(-1)[k].item() if not x.dtype.hasobject else x.reshape(-1)[k]) for x in (first, second)]
    many = f"{int((~alike).sum())} of {alike.size} values, first " if alike.size > 1 else ""
    return f"{many}{values[0][:60]}, here {values[1][:60]}"


if __name__ == "__main__":
    main()
