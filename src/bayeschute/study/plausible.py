"""Plausibility of a study's flights: the laws applied to their records and vehicle. Nothing here imports JAX."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.clean import channels
from bayeschute.records.descent_window import DescentWindow, descent_window
from bayeschute.records.outliers import find_faulty
from bayeschute.records.plausibility.evidence import Nominal, evidence_of
from bayeschute.records.plausibility.reading import accepts
from bayeschute.records.plausibility.scatter import scatter_of_channels
from bayeschute.records.plausibility.verdict import Finding, Verdict, verdict
from bayeschute.report.wording import shown_unit
from bayeschute.study.body_axes import with_axes
from bayeschute.study.schema.belief_schema import NOISE_UNITS, NoiseTable
from bayeschute.study.schema.study_schema import ConventionsTable
from bayeschute.study.schema.vehicle_schema import CapsuleTable, Vehicle, from_centre_of_mass
from bayeschute.study.schema.wind_schema import ProfileTable

if TYPE_CHECKING:
    import xarray as xr

    from bayeschute.study.study import Flight, Study

Array = NDArray[np.float64]
_FAR = np.log(3.0)  # of a scatter from what a study says, where a fit may be led astray
_BREATHING, _DETUNED = 0.9, np.log(1.6)  # its frequency times diameter over speed; how far from that it is told


def nominal(vehicle: Vehicle, capsule_mass: float | None = None) -> Nominal:
    """What laws need of a vehicle.

    Args:
        vehicle: The vehicle, which may be one in part.
        capsule_mass: Replaces the vehicle's [kg].
    """
    c, k, r = (getattr(vehicle, name, None) for name in ("capsule", "canopies", "risers"))
    mass = _known(c, "mass") if capsule_mass is None else capsule_mass
    return Nominal(
        mass=mass,
        attach_b=_attach(c),
        inertia=np.asarray(_known(c, "inertia", (np.nan,) * 3)),
        capsule_length=_known(c, "reference_length"),
        capsule_area=_known(c, "reference_area"),
        capsule_drag=_drag(c),
        canopies=_known(k, "number"),
        area=_known(k, "reference_area"),
        diameter=_known(k, "reference_length"),
        dry_mass=_known(k, "dry_mass"),
        volume=_known(k, "enclosed_volume"),
        riser_length=_known(r, "length"),
        stiffness=_known(r, "stiffness"),
    )


def _known(table: object, name: str, unknown: Any = np.nan) -> Any:
    """A value of a table in part; NaN, of which no law says anything, where it is not known."""
    return getattr(table, name, unknown)


def _attach(capsule: CapsuleTable | None) -> Array:
    """Attach point from the centre of mass, body axes (3,) [m]; NaN too where the frame of the points is not valid."""
    none, invalid = (np.nan,) * 3, object()
    attach, centre = _known(capsule, "attach_point", none), _known(capsule, "centre_of_mass", none)
    frame = _known(capsule, "points_in", invalid)
    return np.asarray(none if frame is invalid else from_centre_of_mass(attach, centre, frame))


def _drag(capsule: CapsuleTable | None) -> float:
    """Drag coefficient of a capsule [1]."""
    table = _known(capsule, "table", None)
    if table is not None:
        return float(abs(np.mean(table.arrays().get("C_A", np.zeros((1, 1)))[-1])))
    return abs(_known(capsule, "axial_force") or 0.0)


def wind_by_altitude(table: ProfileTable) -> Callable[[Array], Array]:
    """Wind of a profile at altitudes (T,) [m], NED (T, 3) [m/s]; its ends hold beyond."""
    rows = table.rows()

    def at(altitude: Array) -> Array:
        return np.stack([np.interp(altitude, rows[:, 0], rows[:, j]) for j in (1, 2, 3)], axis=1)

    return at


def judge(
    record: xr.Dataset,
    vehicle: Vehicle | None,
    capsule_mass: float | None = None,
    window: tuple[float, float] | None = None,
    profile: ProfileTable | None = None,
    body_axes: str | None = None,
) -> Verdict:
    """What the laws say of a record as read, and the mistakes that explain it.

    Args:
        record: In SI, at its own times.
        vehicle: That flew it; None: a point mass.
        capsule_mass: Replaces the vehicle's [kg].
        window: First and last time used [s]; None: all.
        profile: Wind by altitude; None: none.
        body_axes: With which it was read (`axes_said`); None: with none.
    """
    known = None if vehicle is None else nominal(vehicle, capsule_mass)
    aloft = None if profile is None else wind_by_altitude(profile)
    found = verdict(evidence_of(record, known, window, aloft, body_axes))
    return with_axes(found, body_axes)


def axes_said(record: xr.Dataset, path: Path | None, conventions: ConventionsTable | None) -> str | None:
    """`body_axes` with which a record was read; None: of a file in the schema, or of a record that doesn't tell.

    Args:
        record: As read.
        path: Its file; None: in memory.
        conventions: Of the file; None: the usual ones.
    """
    if path is None:
        return record.attrs.get("body_axes")
    return None if path.suffix == ".nc" else (conventions or ConventionsTable()).body_axes


def window_used(
    record: xr.Dataset, window: tuple[float, float] | None, skip_first: float, roles: tuple[str, ...]
) -> DescentWindow:
    """First and last time of a record that are used: as the study says, or as found in the record.

    A flight that is only predicted is used as long as it is, since little of its record need be known.

    Args:
        record: In SI, at its own times.
        window: As the study says; None: it doesn't.
        skip_first: What the study leaves out at the start [s]; where it does, the start is not sought.
        roles: Of the flight.
    """
    time = record["time"].values
    if window is not None:
        return DescentWindow(*window, "")
    if not {"structure", "identify"} & set(roles):
        return DescentWindow(float(time[0]), float(time[-1]), "")
    return descent_window(record, begins=skip_first <= 0.0)


def told(found: Verdict, where: str, accepted: tuple[str, ...] = ()) -> list[Fault]:
    """Faults of a record that can't be true, one for each cause; the one that explains most first.

    Causes after it were sought with it undone, and what no mistake explains may be its doing, so they say so.

    Args:
        found: What the laws say.
        where: The flight, as messages name it.
        accepted: Laws, or groups of them, whose breach the study accepts.
    """
    groups = _by_cause(found.faults, accepted, found.causes)
    first = groups[0][0].likely if groups else ""
    return [_fault(group, where, first) for group in groups]


def warned(found: Verdict, where: str, accepted: tuple[str, ...] = ()) -> list[str]:
    """Warnings of a record: what is nearly out of bounds, and faults that the study accepts.

    What is nearly out of bounds is told where nothing is a fault: else it may well be its consequence.
    """
    groups = _by_cause(found.warnings, accepted, found.causes) if not told(found, where, accepted) else []
    lines = [str(_fault(group, where)).replace("; wanted", "; usual is", 1) for group in groups]
    kept = [one for one in found.faults if accepts(accepted, one.law)]
    return [*lines, *(f"{where}: accepted as the study says ({one.law}): {one.tests}, {one.got}" for one in kept)]


def noise_told(
    record: xr.Dataset,
    noise: NoiseTable,
    vehicle: Vehicle | None,
    window: tuple[float, float] | None = None,
    where: str = "",
) -> list[str]:
    """Warnings where scatter or breathing is far from what a study says, and where a fitted channel's level jumps.

    A fit finds the noise, but it begins at what the study says, and far from there it may take noise for motion.

    Args:
        record: As read.
        noise: The study's ``[noise]``.
        vehicle: That flew, which may be one in part.
        window: First and last time used [s]; None: all.
        where: The flight, as messages name it; empty: not named.
    """
    of, told = f"{where}, " if where else "", (_scatter_told(record, noise), _breathing_told(vehicle, noise))
    return [f"{of}{one}" for one in (*told[0], *_shifts_told(record, noise, window), *told[1])]


def usual_noise(record: xr.Dataset, noise: NoiseTable, vehicle: Vehicle | None) -> NoiseTable:
    """Noise of the kind that a study has, as large as a record shows and as fast as a vehicle breathes.

    The white part of a channel is the scatter of its samples, the correlated part as many times that as in the study;
    breathing has the usual frequency of such canopies. Channels that tell no scatter stay as they are, as do wind and
    forces.

    Args:
        record: As read.
        noise: ``[noise]`` of the study.
        vehicle: That flew; None of a point mass.
    """
    made, seen = dict[str, Any](), scatter_of_channels(record)
    for name, table in noise.channels().items():
        if name in seen and table.white:
            correlated = None if table.correlated is None else seen[name] * table.correlated / table.white
            made[name] = table.model_copy(update={"white": seen[name], "correlated": correlated})
    if noise.breathing is not None and np.isfinite(usual := _usual_breathing(vehicle)):
        made["breathing"] = noise.breathing.model_copy(update={"frequency": usual})
    return noise.model_copy(update=made)


def noise_shown(record: xr.Dataset) -> list[str]:
    """White noise that the samples of a record's channels show, as `[noise]` takes it; empty where none is told.

    Args:
        record: As read.
    """
    said = [f"{name} white = {_as_said(name, sd)!r}" for name, sd in scatter_of_channels(record).items()]
    return [f"the samples scatter by {', '.join(said)}"] if said else []


def _as_said(channel: str, sd: float) -> str:
    scale, unit = shown_unit(NOISE_UNITS[channel])
    return f"{scale * sd:.2g} {unit}".rstrip()


def _scatter_told(record: xr.Dataset, noise: NoiseTable) -> Iterator[str]:
    seen = scatter_of_channels(record)
    for name, table in noise.channels().items():
        if name in seen and table.white and abs(np.log(seen[name] / table.white)) > _FAR:
            got = _as_said(name, seen[name])
            usual = f"what [noise] says, white = {_as_said(name, table.white)}"
            do = f"Say white = '{got}', and correlated in proportion."
            yield f"scatter of {name} from sample to sample: got {got}; usual is {usual}. {do}"


def _shifts_told(record: xr.Dataset, noise: NoiseTable, window: tuple[float, float] | None) -> Iterator[str]:
    """Cleaning finds them, and leaves them: which of both levels is right it cannot know."""
    start, end = window or (-np.inf, np.inf)
    for channel in channels(record):
        if channel.variable not in noise.channels():
            continue
        for one in find_faulty(channel)[1]:
            if one.kind == "level_shift" and start <= one.end and one.start <= end:
                do = "A fit takes it for motion or slow noise: leave the channel out of [noise], or end `window` there."
                yield f"{one.variable} at {one.start:g} s: {one.detail}. {do}"


def _breathing_told(vehicle: Vehicle | None, noise: NoiseTable) -> Iterator[str]:
    """Its frequency is sought within a factor of two."""
    usual = _usual_breathing(vehicle)
    if noise.breathing is not None and abs(np.log(noise.breathing.frequency / usual)) > _DETUNED:
        got = f"{noise.breathing.frequency:.2g} Hz in [noise.breathing]"
        rule = f"{_BREATHING:g} times the canopies' reference speed over their diameter, {usual:.2g} Hz"
        do = f"Say frequency = '{usual:.2g} Hz', unless more is known: it is sought within a factor of two."
        yield f"frequency of breathing: got {got}; usual is {rule}. {do}"


def _usual_breathing(vehicle: Vehicle | None) -> float:
    """Frequency of the CPAS canopies, scaled by speed over diameter [Hz]; NaN where these are not known."""
    canopies = getattr(vehicle, "canopies", None)
    return _BREATHING * _known(canopies, "reference_speed") / _known(canopies, "reference_length")


def _by_cause(findings: tuple[Finding, ...], accepted: tuple[str, ...], causes: tuple[str, ...]) -> list[list[Finding]]:
    """Findings that are not accepted, by their likeliest cause, in the order of these; the worst of each first."""
    groups: dict[str, list[Finding]] = {cause: [] for cause in (*causes, "")}
    for one in findings:
        if not accepts(accepted, one.law):
            groups.setdefault(one.likely, []).append(one)
    return [sorted(group, key=lambda one: -one.excess) for group in groups.values() if group]


def _fault(group: list[Finding], where: str, first: str = "") -> Fault:
    """A fault of findings of one cause.

    Args:
        group: The findings, the worst first.
        where: The flight, as messages name it.
        first: Cause told before it; empty: none.
    """
    worst = group[0]
    laws = ", ".join(one.law for one in group)
    if not worst.causes:
        do = "Also, perhaps a consequence of the first cause." if first else "No single known mistake explains it."
    else:
        later = first and worst.likely != first
        do = f"{'With the first cause mended, likely is' if later else 'Likely cause'}: {worst.likely}. {worst.do}"
        others = worst.causes[1:]
        do += f" Or: {'; '.join(others)}." if others else ""
    if worst.severity == "fault":
        do += f" If it is true all the same: accept_implausible = {json.dumps([one.law for one in group])}."
    return Fault(f"{where}, {worst.tests}", f"{worst.got} ({laws})", worst.wanted, do)


def refuse_implausible(study: Study, flight: Flight, raw: xr.Dataset) -> list[str]:
    """Refuse a flight whose record can't be true.

    Args:
        study: Its study.
        flight: A flight with a record.
        raw: The record as read.

    Returns:
        Warnings.

    Raises:
        InputError: With the likely causes.
    """
    vehicle = study.vehicle_of(flight) if study.model == "cluster" else None
    used = window_used(raw, flight.window, flight.skip_first, flight.roles)
    said = axes_said(raw, flight.path, flight.conventions)
    found = judge(raw, vehicle, flight.capsule_mass, (used.start, used.end), flight.wind_profile, said)
    where = f"flight {flight.name!r}"
    faults = told(found, where, flight.accept_implausible)
    if faults:
        raise InputError(faults)
    lines = warned(found, where, flight.accept_implausible)
    fitted = "identify" in flight.roles
    return lines + (noise_told(raw, study.noise, vehicle, (used.start, used.end), where) if fitted else [])
