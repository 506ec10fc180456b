"""The flight record: one xarray.Dataset with named, dimensioned variables in SI; NaN marks what is missing."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.units import factor_to_si
from bayeschute.records.netcdf import open_netcdf

if TYPE_CHECKING:
    import xarray as xr

AXIS = ("north", "east", "down")
BODY_AXIS = ("x", "y", "z")
QUATERNION = ("w", "x", "y", "z")
LABELS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"axis": AXIS, "body_axis": BODY_AXIS, "quaternion": QUATERNION}
)

_ORDER = ("time", "canopy", "axis", "body_axis", "quaternion")


@dataclass(frozen=True)
class Variable:
    """What a variable of a record is.

    Attributes:
        dims: Its dimensions, time first.
        unit: SI unit, as pint spells it.
        meaning: One line for readers.
        least: Smallest value that can be true, in `unit`.
        most: Largest value that can be true.
    """

    dims: tuple[str, ...]
    unit: str
    meaning: str
    least: float = -np.inf
    most: float = np.inf


_LATEST = 1e11  # some thousand years [s]
_T = ("time",)
VARIABLES: Mapping[str, Variable] = MappingProxyType(
    {
        "capsule_position": Variable(("time", "axis"), "m", "centre of mass of the capsule, NED", -1e7, 1e7),
        "capsule_velocity": Variable(("time", "axis"), "m/s", "velocity of the centre of mass, NED", -3000.0, 3000.0),
        "capsule_attitude": Variable(("time", "quaternion"), "1", "unit quaternion from NED to body", -1.1, 1.1),
        "capsule_rate": Variable(("time", "body_axis"), "rad/s", "angular velocity, body axes", -1000.0, 1000.0),
        "capsule_specific_force": Variable(
            ("time", "body_axis"), "m/s^2", "non-gravitational acceleration at the centre of mass, body axes", -1e4, 1e4
        ),
        "canopy_position": Variable(
            ("time", "canopy", "axis"), "m", "centre of each canopy, NED, same origin as capsule_position", -1e7, 1e7
        ),
        "canopy_velocity": Variable(
            ("time", "canopy", "axis"), "m/s", "velocity over ground of the centre of each canopy, NED", -3000.0, 3000.0
        ),
        "riser_tension": Variable(("time", "canopy"), "N", "pull of each riser", -1e3, 1e8),
        "wind": Variable(("time", "axis"), "m/s", "velocity of the air, NED", -200.0, 200.0),
        "density": Variable(_T, "kg/m^3", "density of the air", 1e-6, 3.0),
        "altitude": Variable(_T, "m", "geometric altitude above the sea", -5000.0, 1e5),
        "pressure": Variable(_T, "Pa", "static pressure of the air", 0.1, 2e5),
        "temperature": Variable(_T, "K", "temperature of the air", 100.0, 400.0),
        "latitude": Variable(_T, "rad", "geodetic latitude, north positive", -np.pi / 2, np.pi / 2),
        "longitude": Variable(_T, "rad", "longitude, east positive", -2 * np.pi, 2 * np.pi),
        "descent_rate": Variable(_T, "m/s", "velocity downward", -3000.0, 3000.0),
        "swing_angle": Variable(_T, "rad", "angle of the cluster off the vertical (6.1-18)", -np.pi, np.pi),
    }
)
# Beside a virtual record lies the truth: the same variables and these.
QUANTITIES: Mapping[str, Variable] = MappingProxyType(
    {
        "flyout_angle": Variable(_T, "rad", "half the angle between the risers (6.1-20)"),
        "sea_level_descent_rate": Variable(_T, "m/s", "descent rate at the same dynamic pressure in sea-level air"),
        "turbulence": Variable(("time", "axis"), "m/s", "part of the wind that the record doesn't know, NED"),
    }
)


@dataclass(frozen=True)
class Repair:
    """What was done to a record, or what is missing in it.

    Attributes:
        kind: ``gap``, ``interpolated``, ``out_of_range``, ``stuck``, ``spike``, ``level_shift``, ``skipped``,
            ``resampled``, ``derived``, ``assumed``.
        variable: Name, with the canopy where one is meant (``canopy_position.1``).
        start: First time concerned [s].
        end: Last time concerned [s].
        count: Samples concerned.
        detail: One sentence.
        times: Where the series was interpolated from a slower one, times of the samples that it has [s]; else empty.
    """

    kind: str
    variable: str
    start: float
    end: float
    count: int
    detail: str = ""
    times: tuple[float, ...] = ()


def repairs(ds: xr.Dataset) -> tuple[Repair, ...]:
    """The repairs listed in a record's attributes, in order; empty where none are.

    Raises:
        InputError: If the attribute is no such list.
    """
    text = ds.attrs.get("repairs", "[]")
    try:
        found = tuple(Repair(**{**entry, "times": tuple(entry.get("times", ()))}) for entry in json.loads(text))
        for entry in found:  # texts and numbers of any other kind would fail long after, in the report
            np.array([entry.start, entry.end, entry.count, *entry.times]).astype(float, casting="safe")
            "".join((entry.kind, entry.variable, entry.detail))
        return found
    except (AttributeError, TypeError, ValueError, RecursionError) as error:
        raise InputError(
            Fault("record, attribute repairs", repr(text)[:80], "a JSON list of repairs", "Delete the attribute.")
        ) from error


def with_repairs(ds: xr.Dataset, more: Iterable[Repair]) -> xr.Dataset:
    """The record with further repairs appended to its list."""
    every = [asdict(entry) for entry in (*repairs(ds), *more)]
    entries = [{key: value for key, value in entry.items() if key != "times" or value} for entry in every]
    return ds.assign_attrs(repairs=json.dumps(entries))


def nearest(name: str, known: Iterable[str]) -> str:
    """Advice naming the likeliest meant names, or an empty string."""
    close = difflib.get_close_matches(name, list(known), n=2, cutoff=0.5)
    return f"Did you mean {' or '.join(repr(c) for c in close)}?" if close else ""


def _labels(dim: str, size: int) -> Any:
    return list(LABELS[dim]) if dim in LABELS else np.arange(1, size + 1)


def make_record(**arrays: Any) -> xr.Dataset:
    """Build a record from arrays in SI.

    Args:
        arrays: ``time`` (T,) and any variables of `VARIABLES` or `QUANTITIES`, shaped as their dims.

    Returns:
        The record; every variable has its unit; ``repairs`` is an empty list.

    Raises:
        InputError: On a missing time, an unknown name or a wrong shape; all at once.
    """
    import xarray as xr

    known = {**VARIABLES, **QUANTITIES}
    if "time" not in arrays:
        raise InputError(Fault("record", "no time", "a time array [s]"))
    time = np.asarray(arrays["time"], dtype=float)
    faults = [] if time.ndim == 1 else [Fault("record time", f"shape {time.shape}", "one dimension")]
    sizes: dict[str, int] = {"time": time.size, **{dim: len(labels) for dim, labels in LABELS.items()}}
    data: dict[str, Any] = {}
    coords: dict[str, Any] = {"time": ("time", time.ravel(), {"units": "s"})}
    for name, values in arrays.items():
        if name == "time":
            continue
        if name not in known:
            faults.append(Fault(f"record {name}", "an unknown variable", "one of the schema", nearest(name, known)))
            continue
        array, variable = np.asarray(values, dtype=float), known[name]
        if array.ndim == len(variable.dims) and "canopy" in variable.dims:
            sizes.setdefault("canopy", array.shape[1])
        shape = tuple(sizes.get(dim, 0) for dim in variable.dims)
        if array.shape != shape:
            wanted = ", ".join(f"{dim} {sizes.get(dim, 'n')}" for dim in variable.dims)
            faults.append(Fault(f"record {name}", f"shape {array.shape}", f"({wanted})"))
            continue
        data[name] = (variable.dims, array, {"units": variable.unit, "long_name": variable.meaning})
        coords |= {dim: (dim, _labels(dim, sizes[dim])) for dim in variable.dims if dim != "time"}
    if faults:
        raise InputError(faults)
    return xr.Dataset(data, coords, {"repairs": "[]"})


def _variable_faults(ds: xr.Dataset, name: str, variable: Variable, where: str, empty: bool) -> list[Fault]:
    """Faults of one variable: dimensions, labels, type, unit."""
    array, place = ds[name], f"{where} {name}"
    if set(array.dims) != set(variable.dims):
        return [Fault(place, f"dimensions {tuple(array.dims)}", f"{variable.dims}", "Rename or transpose.")]
    if array.dtype.kind not in "fiu":
        return [Fault(place, f"values of type {array.dtype}", "numbers")]
    faults = []
    for dim in variable.dims:
        if dim in LABELS and (dim not in ds.coords or tuple(map(str, ds[dim].values)) != LABELS[dim]):
            got = str(ds[dim].values.tolist())[:60] if dim in ds.coords else f"no labels of {dim}"
            faults.append(Fault(place, got, f"{dim} = {list(LABELS[dim])}", "Label and order the components so."))
    unit = array.attrs.get("units")
    if not isinstance(unit, str):
        faults.append(Fault(place, "no unit", f"the attribute units, for example '{variable.unit}'"))
        return faults
    try:
        scale, zero = factor_to_si(unit, variable.unit)
    except ValueError as error:
        faults.append(Fault(f"{place} units", repr(unit)[:60], f"a unit of {variable.unit}", f"({error})"))
        return faults
    with np.errstate(over="ignore"):
        infinite = int(np.isinf(scale * array.values.astype(float) + zero).sum())
    if infinite:
        got = f"{infinite} infinite values in {variable.unit}"
        faults.append(Fault(place, got, "finite numbers or NaN", "Is the unit right?"))
    elif not empty and not np.isfinite(array.values).any():
        faults.append(Fault(place, "no value at all", "at least one number", "Leave the variable out."))
    return faults


def time_faults(time: Any, where: str, rows: Any = None) -> list[Fault]:
    """Faults of a time axis: missing, infinite, backward or repeated times.

    Args:
        time: (T,) [s].
        where: Place for messages.
        rows: Row of every sample in its file (T,); samples are counted from 0 where none are given.

    Returns:
        The faults, at most one of each kind, naming the first offender and their number.
    """
    word, number = ("sample", np.arange(len(time))) if rows is None else ("row", rows)
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        got = f"no finite time in {word} {number[bad[0]]} ({bad.size} in all)"
        return [Fault(where, got, "a finite time in every row", "Drop those rows.")]
    far = np.flatnonzero(np.abs(time) > _LATEST)
    if far.size:
        got = f"the time {time[far[0]]:g} s in {word} {number[far[0]]} ({far.size} such)"
        return [Fault(where, got, f"times within {_LATEST:g} s of zero", "Is the unit right?")]
    step = np.diff(time)
    faults = []
    for found, got in ((step < 0.0, "time running backward"), (step == 0.0, "repeated time")):
        at = np.flatnonzero(found)
        if at.size:
            i = int(at[0])
            text = f"{got} at {word} {number[i + 1]} ({time[i]:.17g} then {time[i + 1]:.17g} s; {at.size} in all)"
            faults.append(Fault(where, text, "times that increase strictly", "Sort the rows, drop repeated ones."))
    return faults


def validate_record(
    ds: xr.Dataset, where: str, known: Mapping[str, Variable] = VARIABLES, empty: bool = False
) -> list[Fault]:
    """Check a record against the schema.

    Args:
        ds: The record.
        where: File or flight, for messages.
        known: Variables that may occur.
        empty: Whether variables may be missing throughout (as after cutting a window out of a record).

    Returns:
        Every fault; an empty list where the record is good.
    """
    faults = []
    if "time" not in ds.coords or ds["time"].dims != ("time",):
        return [Fault(where, "no coordinate time", "time [s] along the dimension time")]
    if ds["time"].dtype.kind not in "fiu":
        return [Fault(f"{where} time", f"type {ds['time'].dtype}", "numbers [s]")]
    faults += time_faults(ds["time"].values.astype(float), f"{where} time")
    unit = ds["time"].attrs.get("units", "s")
    if not isinstance(unit, str) or unit != "s":  # an attribute may be a list
        faults.append(Fault(f"{where} time units", repr(unit)[:60], "'s'"))
    if "canopy" in ds.dims:
        count = ds.sizes["canopy"]
        labels = ds["canopy"].values.tolist() if "canopy" in ds.coords else None
        if labels != list(range(1, count + 1)):
            faults.append(Fault(f"{where} canopy", str(labels)[:60], f"labels 1 to {count}"))
    for name in map(str, ds.coords):
        if name in known:  # else it would be left out of the record without a word
            do = "Take it out of the attribute coordinates."
            faults.append(Fault(f"{where} {name}", "a coordinate", "a variable along time", do))
    for name in map(str, ds.data_vars):
        if name in known:
            faults += _variable_faults(ds, name, known[name], where, empty)
        else:
            advice = nearest(name, known) or "Leave it out."
            faults.append(Fault(f"{where} {name}", "an unknown variable", "one of the schema", advice))
    try:
        repairs(ds)
    except InputError as error:
        faults += [Fault(f"{where} [attribute repairs]", f.got, f.wanted, f.do) for f in error.faults]
    if not ds.data_vars:
        faults.append(Fault(where, "no variable", "at least one of the schema"))
    return faults


def values_of(record: xr.Dataset, name: str) -> NDArray[np.float64]:
    """Values of a variable, dimensions in the order of the schema: time, canopy, axis."""
    return np.asarray(record[name].transpose(*[d for d in _ORDER if d in record[name].dims]).values, dtype=float)


def in_si(ds: xr.Dataset, known: Mapping[str, Variable] = VARIABLES) -> xr.Dataset:
    """A valid record in SI, float64, dimensions in the schema's order; the attribute ``repairs`` is present."""
    out = ds.transpose(*[d for d in _ORDER if d in ds.dims])
    for name in map(str, ds.data_vars):
        unit = known[name].unit
        scale, zero = factor_to_si(ds[name].attrs["units"], unit)
        values = out[name].values.astype(float)
        with np.errstate(over="ignore"):
            values = values if (scale, zero) == (1.0, 0.0) else scale * values + zero
        attrs = {"units": unit, "long_name": known[name].meaning}
        out = out.assign({name: (out[name].dims, values, attrs)})
    out = out.assign_coords(time=("time", ds["time"].values.astype(float), {"units": "s"}))
    return out.assign_attrs(repairs=out.attrs.get("repairs", "[]"))


def write_record(ds: xr.Dataset, path: Path | str) -> Path:
    """Write a record (or the truth beside it) as NetCDF; all attributes are kept.

    Raises:
        InputError: If it does not fit the schema.
    """
    from bayeschute.core.netcdf_files import write_netcdf

    path = Path(path)
    faults = validate_record(ds, str(path), {**VARIABLES, **QUANTITIES}, empty=True)
    if faults:
        raise InputError(faults)
    summed = {str(name): {"fletcher32": True} for name in ds.data_vars}  # damage shows when the file is read
    write_netcdf(ds, path, encoding=summed)
    return path


def load_record(path: Path | str) -> xr.Dataset:
    """Read a record, or the truth beside one, that `write_record` wrote.

    Raises:
        InputError: If the file is missing, damaged or doesn't fit the schema.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(Fault(str(path), "no such file", "a NetCDF record"))
    known = {**VARIABLES, **QUANTITIES}
    ds = open_netcdf(path, trusted=True)
    faults = validate_record(ds, str(path), known, empty=True)
    if faults:
        raise InputError(faults)
    return in_si(ds, known)
