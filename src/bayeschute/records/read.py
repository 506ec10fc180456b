"""Reading of measured flights: CSV, Parquet or NetCDF in, a valid record in SI out, every fault at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.units import factor_to_si
from bayeschute.records.foreign.clocks import ISO, continued, in_order, of_stamps
from bayeschute.records.foreign.conventions import USUAL, Conventions, convention_faults
from bayeschute.records.foreign.translate import WEEK, fill_rates, foreign_unit, in_schema_keys, schema_keys
from bayeschute.records.netcdf import open_netcdf
from bayeschute.records.record import (
    AXIS,
    LABELS,
    VARIABLES,
    Repair,
    in_si,
    make_record,
    nearest,
    time_faults,
    validate_record,
    with_repairs,
)
from bayeschute.records.text_table import SHOWN, Table, numbers, read_csv, read_parquet

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

MOST_CANOPIES = 16
MIN_ROWS = 10
_SUFFIXES = (".csv", ".csv.gz", ".parquet", ".nc")


@dataclass(frozen=True)
class ColumnSpec:
    """Where a quantity stands in a file.

    Attributes:
        column: Name of the column.
        unit: Its unit, e.g. ``"hPa"``; ``""`` for a pure number; ``"iso"`` of times as stamps.
        scale: What its numbers are multiplied with before they are in that unit: gain, or -1 for the opposite sense.
        offset: What is added after that, in that unit.
    """

    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class _Target:
    """Where a column goes: variable, canopy (index from 0 or None), component (index or None), SI unit."""

    variable: str
    canopy: int | None
    component: int | None
    unit: str


def _target(key: str) -> _Target | Fault:
    """Place in the record of a key of the column map, e.g. ``canopy_position.1.down``."""
    where = f"[columns.{key}]"
    if key == "time":
        return _Target("time", None, None, "s")
    unit = foreign_unit(key)
    if unit is not None and key.split(".")[-1] not in AXIS:
        numbered = _target(".".join([*key.split(".")[:-1], "down"])) if key.count(".") == 2 else None
        return numbered if isinstance(numbered, Fault) else _Target("", None, None, unit)
    name, *rest = key.split(".")
    if name not in VARIABLES:
        known = ["time", *VARIABLES]
        return Fault(where, "an unknown quantity", f"one of {', '.join(known)}", nearest(name, known))
    variable = VARIABLES[name]
    wanted = ".".join([name, *("<number>" if d == "canopy" else f"<{'|'.join(LABELS[d])}>" for d in variable.dims[1:])])
    if len(rest) != len(variable.dims) - 1:
        return Fault(where, f"{len(rest)} parts after the name", f"a key like {wanted}")
    canopy = component = None
    for dim, part in zip(variable.dims[1:], rest, strict=True):
        if dim == "canopy":
            if not (part.isascii() and part.isdigit() and 1 <= int(part[:9]) <= MOST_CANOPIES):
                return Fault(where, f"canopy {part!r}", f"a number from 1 to {MOST_CANOPIES}")
            canopy = int(part) - 1
        elif part not in LABELS[dim]:
            return Fault(where, f"component {part!r}", f"one of {', '.join(LABELS[dim])}", nearest(part, LABELS[dim]))
        else:
            component = LABELS[dim].index(part)
    return _Target(name, canopy, component, variable.unit)


def _map_faults(targets: Mapping[str, _Target]) -> list[Fault]:
    """Faults of the column map as a whole: no time, no quantity, missing components or canopies."""
    faults = []
    if "time" not in targets:
        advice = 'For example time = {column = "t", unit = "s"}.'
        faults.append(Fault("[columns]", "no time", "a column for time", advice))
    if not set(targets) - {"time"}:
        faults.append(Fault("[columns]", "no quantity", "at least one of the record's variables besides time"))
    for name in dict.fromkeys(t.variable for t in targets.values() if t.variable != "time"):
        dims = VARIABLES[name].dims[1:]
        given = {(t.canopy, t.component) for t in targets.values() if t.variable == name}
        count = 1 + max((c for c, _ in given if c is not None), default=-1)
        canopies: list[int | None] = list(range(count)) if "canopy" in dims else [None]
        labelled = next((d for d in dims if d in LABELS), None)
        parts: list[int | None] = list(range(len(LABELS[labelled]))) if labelled else [None]
        for canopy in canopies:
            for part in parts:
                optional = name == "wind" and part == 2
                if (canopy, part) in given or optional:
                    continue
                words = [name, *([str(canopy + 1)] if canopy is not None else [])]
                words += [LABELS[labelled][part]] if labelled and part is not None else []
                faults.append(Fault("[columns]", f"no {'.'.join(words)}", f"every component of {name}"))
    return faults


def _count_of_canopies(targets: Mapping[str, _Target]) -> list[Fault]:
    """A fault where the variables by canopy don't agree on their number."""
    counts: dict[str, int] = {}
    for t in targets.values():
        if t.canopy is not None:
            counts[t.variable] = max(counts.get(t.variable, 0), t.canopy + 1)
    if len(set(counts.values())) <= 1:
        return []
    got = ", ".join(f"{name} for {n}" for name, n in counts.items())
    return [Fault("[columns]", got, "the same number of canopies everywhere")]


def _column_names(names: list[str]) -> str:
    shown = ", ".join(name[:SHOWN] for name in names[:30])
    return shown + (f" and {len(names) - 30} more" if len(names) > 30 else "")


def _columns_si(
    table: Table, columns: Mapping[str, ColumnSpec], targets: Mapping[str, _Target], where: str
) -> tuple[dict[str, Array], list[Fault]]:
    """The mapped columns in SI, and every fault of them."""
    found: dict[str, Array] = {}
    faults: list[Fault] = []
    for key, target in targets.items():
        spec = columns[key]
        factors = None
        stamps = key == "time" and spec.unit == ISO
        try:
            factors = (1.0, 0.0) if stamps else factor_to_si(spec.unit, target.unit)
        except ValueError as error:
            wanted = f"a unit of {'pure numbers' if target.unit == '1' else target.unit}"
            faults.append(Fault(f"[columns.{key}] unit", repr(spec.unit)[:SHOWN], wanted, f"({error})"))
        if spec.column not in table.names:
            advice = f"{nearest(spec.column, table.names)} The columns are {_column_names(table.names)}.".strip()
            got = f"column {spec.column!r}, which {where} lacks"
            faults.append(Fault(f"[columns.{key}]", got, "a column of the file", advice))
            continue
        read = of_stamps if stamps else numbers
        values, wrong = read(table.frame[spec.column], f"{where} column {spec.column!r}", table.first_row)
        faults += wrong
        if wrong or factors is None:
            continue
        with np.errstate(over="ignore"):
            found[key] = factors[0] * (spec.scale * values + spec.offset) + factors[1]
        if np.isinf(found[key]).any():
            got = f"a value too large to convert from {spec.unit} to {target.unit}"
            faults.append(
                Fault(f"{where} column {spec.column!r}", got, "values that can be true", "Is the unit right?")
            )
    return found, faults


def _assembled(found: Mapping[str, Array], targets: Mapping[str, _Target]) -> xr.Dataset:
    """The record from its columns."""
    time, notes = found["time"], []
    arrays: dict[str, Array] = {}
    for key, target in targets.items():
        if key == "time":
            continue
        variable = VARIABLES[target.variable]
        canopies = 1 + max((t.canopy or 0) for t in targets.values() if t.variable == target.variable)
        shape = [time.size, *(canopies if d == "canopy" else len(LABELS[d]) for d in variable.dims[1:])]
        array = arrays.setdefault(target.variable, np.full(shape, np.nan))
        place: list[int | slice] = [i for i in (target.canopy, target.component) if i is not None]
        array[tuple([slice(None), *place])] = found[key]
    if "wind" in arrays and "wind.down" not in found:
        arrays["wind"][:, 2] = 0.0
        detail = "no column for wind.down: taken as zero"
        notes.append(Repair("assumed", "wind", float(time[0]), float(time[-1]), time.size, detail))
    return with_repairs(make_record(time=time, **arrays), notes)


def _span_faults(time: Array, window: tuple[float, float] | None, min_rows: int, where: str) -> list[Fault]:
    """Faults of the record's length and of the window wanted from it."""
    if time.size < min_rows:
        return [Fault(where, f"{time.size} rows", f"at least {min_rows}", "Give a longer record.")]
    if window is None:
        return []
    start, end = window
    if not (np.isfinite(start) and np.isfinite(end) and start < end):
        return [Fault(f"{where} window", f"{start} to {end} s", "a finite end after a finite start")]
    slack = 2.5 * float(np.median(np.diff(time)))
    if start < time[0] - slack or end > time[-1] + slack:
        got = f"a record from {time[0]:g} to {time[-1]:g} s"
        return [Fault(where, got, f"the window {start:g} to {end:g} s", "Shorten the window.")]
    rows = int(((time >= start) & (time <= end)).sum())
    if rows < min_rows:
        return [Fault(f"{where} window", f"{rows} rows in {start:g} to {end:g} s", f"at least {min_rows}")]
    return []


def _suffix(path: Path) -> str:
    name = path.name.lower()
    return next((s for s in (".csv.gz", ".csv", ".parquet", ".nc") if name.endswith(s)), "")


def read_record(
    path: Path | str,
    columns: Mapping[str, ColumnSpec] | None = None,
    window: tuple[float, float] | None = None,
    min_rows: int = MIN_ROWS,
    conventions: Conventions = USUAL,
) -> xr.Dataset:
    """Read a flight record.

    Args:
        path: ``.csv``, ``.csv.gz`` or ``.parquet``, with a column map; or ``.nc`` in the project's own schema, whose
            variables are already named, so that the map is not looked at.
        columns: Quantity to column: ``time``, scalars (``altitude``, ``pressure``, ...) and components
            (``capsule_position.north``, ``canopy_position.1.down``, ``capsule_attitude.w``, ``riser_tension.2``).
            ``wind.down`` may be left out and is then zero.
        window: First and last time that will be wanted [s]; the record is not cut, only checked.
        min_rows: Least number of samples, in the window where one is given.
        conventions: Axes, senses and clocks of the record, which names and units of columns don't tell. Not looked at
            where the file is in the project's own schema.

    Returns:
        The record in SI, at the file's own times; see `bayeschute.records.clean.clean` for what comes next.

    Raises:
        InputError: With every fault of the map and the file.
    """
    path = Path(path)
    suffix = _suffix(path)
    map_faults: list[Fault] = []
    targets: dict[str, _Target] = {}
    schema: dict[str, _Target] = {}
    if suffix != ".nc":
        for key in columns or {}:
            target = _target(key)
            if isinstance(target, Fault):
                map_faults.append(target)
            else:
                targets[key] = target
        said = convention_faults(conventions, "[conventions]")
        map_faults += said
        if not map_faults:
            schema, map_faults = _schema(targets, conventions)
    if not suffix:
        map_faults.append(Fault(str(path), f"a file named {path.name!r}"[:100], f"one of {', '.join(_SUFFIXES)}"))
    elif not path.is_file():
        map_faults.append(Fault(str(path), "no such file", "a flight record", _similar_files(path)))
    elif path.stat().st_size == 0:
        map_faults.append(Fault(str(path), "an empty file", "a flight record"))
    else:
        try:
            maps = _Maps(columns or {}, targets, schema, conventions)
            record, faults = _read(path, suffix, maps, window, min_rows)
        except InputError as error:
            raise InputError([*map_faults, *error.faults]) from error
        map_faults += faults
        if record is not None and not map_faults:
            return record
    raise InputError(map_faults)


def _schema(targets: Mapping[str, _Target], said: Conventions) -> tuple[dict[str, _Target], list[Fault]]:
    """Where the schema's components come from, and faults of the column map as a whole."""
    faults = []
    for key in said.lacks:
        if key in targets:
            faults.append(Fault("[conventions] lacks", key, "components without a column", "Remove one of the two."))
        elif isinstance(fault := _target(key), Fault):
            faults.append(replace(fault, where="[conventions] lacks"))
    if faults:
        return {}, faults
    keys, faults = schema_keys([*(key for key in targets if key != "time"), *said.lacks], said)
    schema = {key: target for key in keys if isinstance(target := _target(key), _Target)}
    schema |= {"time": targets["time"]} if "time" in targets else {}
    faults += [*_map_faults(schema), *_count_of_canopies(schema)]
    return ({} if faults else schema), faults


class _Maps(NamedTuple):
    """A column map: as written, where its columns and the schema's components go, and conventions."""

    columns: Mapping[str, ColumnSpec]
    targets: Mapping[str, _Target]
    schema: Mapping[str, _Target]
    said: Conventions


def _similar_files(path: Path) -> str:
    if not path.parent.is_dir():
        return f"The folder {path.parent} does not exist either."
    return nearest(path.name, [p.name for p in list(path.parent.iterdir())[:1000]])


def _read(
    path: Path,
    suffix: str,
    maps: _Maps,
    window: tuple[float, float] | None,
    min_rows: int,
) -> tuple[xr.Dataset | None, list[Fault]]:
    """The record, or None with its faults."""
    where, columns, targets, said = str(path), maps.columns, maps.targets, maps.said
    if suffix == ".nc":
        ds = open_netcdf(path)
        faults = validate_record(ds, where)
        faults += [] if faults else _span_faults(ds["time"].values.astype(float), window, min_rows, where)
        return (None, faults) if faults else (in_si(ds), [])
    reader = read_parquet if suffix == ".parquet" else read_csv
    table = reader(path, {columns[key].column for key in targets})
    if len(table.names) and table.frame.columns.size and len(table.frame) == 0:
        return None, [Fault(where, "no rows", "samples under the header")]
    found, faults = _columns_si(table, columns, targets, where)
    merged = 0
    if "time" in found:
        place = f"{where} column {columns['time'].column!r}"
        rows = table.frame.index.to_numpy() + table.first_row
        found["time"] = continued(found["time"], found.pop(WEEK, None), said)
        found, rows, merged = in_order(found, rows, said)
        wrong = time_faults(found["time"], place, rows)
        faults += wrong or _span_faults(found["time"], window, min_rows, where)
    if faults or "time" not in found or len(found) < 2 or not maps.schema:
        return None, faults
    found |= {key: np.full(found["time"].size, np.nan) for key in said.lacks}
    made = in_schema_keys(found, said)
    filled = fill_rates(made)
    return with_repairs(_assembled(made, maps.schema), _notes(found["time"], filled, merged)), []


def _notes(time: Array, filled: Sequence[str], merged: int) -> list[Repair]:
    """What was done to a record while it was read."""
    start, end = float(time[0]), float(time[-1])
    notes = []
    if filled:
        detail = f"no value about {', '.join(filled)}: from the attitude"
        notes.append(Repair("derived", "capsule_rate", start, end, time.size, detail))
    if merged:
        notes.append(Repair("assumed", "time", start, end, merged, "rows of repeated times were merged"))
    return notes
