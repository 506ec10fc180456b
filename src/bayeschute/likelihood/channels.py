"""From a cleaned record to fitted data: channels, reference initial state, fitted and held-out samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.aero.coefficient import APPARENT_MASS
from bayeschute.compiler.integrate import FlightModel
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.vectors import Component, Quaternion, Vec3, quaternion
from bayeschute.dynamics.cluster_flight import CHANNELS, LOGARITHMIC, ClusterFlight, ClusterInputs, channel_sizes
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs
from bayeschute.dynamics.initial_state import Start, deviation_names, tangent_basis
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.step_size import poles, steps
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData
from bayeschute.likelihood.priors import Prior
from bayeschute.likelihood.record_path import RecordPath, record_path
from bayeschute.records.derive import measured
from bayeschute.records.record import VARIABLES, nearest, repairs

Array = NDArray[np.float64]
_FIRST = 1.5  # [s] of record from which the reference initial state is read
_WIDE = 3.0  # times the scatter of the first samples, which slow noise hardly shows
_SETTLED = 3.0  # times c/k, after which riser tensions do not depend on the initial state
_ALTITUDE_STEP = 100.0  # [m] between nodes of a density profile


def filled(values: Array, where: str) -> Array:
    """A series (T, ...) with gaps interpolated linearly, ends constant: for inputs of a simulation, never for data.

    Raises:
        InputError: If a component has no value at all.
    """
    flat = np.array(values, float).reshape(len(values), -1)
    index = np.arange(len(flat))
    for column in flat.T:
        present = np.isfinite(column)
        if not present.any():
            raise InputError(
                Fault(where, "no value in the window", "at least one", "Use another window or drop the flight.")
            )
        column[:] = np.interp(index, index[present], column[present])
    return flat.reshape(np.shape(values))


class InitialMotion(NamedTuple):
    """A quadratic through the first samples of a record, per column.

    Attributes:
        value: At the first sample.
        slope: Likewise [1/s].
        scatter: Root mean square of the residuals.
    """

    value: Array
    slope: Array
    scatter: Array


def initial_motion(time: Array, values: Array) -> InitialMotion:
    """A quadratic through the first samples of a record (T, ...), or their mean where there are too few."""
    near = time <= time[0] + _FIRST
    ends = []
    for column in values[near].reshape(int(near.sum()), -1).T:
        present = np.isfinite(column)
        degree = 2 if present.sum() >= 6 else 0
        fit = (
            np.polynomial.polynomial.polyfit(time[near][present] - time[0], column[present], degree)
            if present.any()
            else None
        )
        if fit is None:
            ends.append((np.nan, np.nan, np.nan))
            continue
        off = column[present] - np.polynomial.polynomial.polyval(time[near][present] - time[0], fit)
        ends.append((fit[0], fit[1] if degree else 0.0, np.sqrt(np.mean(off**2))))
    return InitialMotion(*(part.reshape(values.shape[1:]) for part in np.array(ends).T))


def fitted_channels(record: xr.Dataset, channels: Sequence[str]) -> tuple[str, ...]:
    """Those of some channels that a record of a cluster has, in order.

    A descent rate that was derived from the recorded velocity is no independent measurement: it is used only where the
    velocity isn't fitted.

    Args:
        record: As of `cluster_data`.
        channels: Channels wanted, of `CHANNELS`.

    Raises:
        InputError: If a channel is unknown, or the record has none of them.
    """
    unknown = [
        Fault("channels", repr(c), " or ".join(CHANNELS), nearest(c, CHANNELS)) for c in channels if c not in CHANNELS
    ]
    if unknown:
        raise InputError(unknown)
    derived = any((r.kind, r.variable) == ("derived", "descent_rate") for r in repairs(record))
    twice = ("descent_rate",) if derived and "capsule_velocity" in channels else ()
    found = tuple(c for c in channels if c in record and c not in twice and np.isfinite(record[c].values).any())
    if not found:
        got = f"no value of {', '.join(channels)}" if channels else "no channel to fit"
        do = "Record one, or give another its table of noise."
        raise InputError(Fault("record of a cluster", got, "one channel at least with a value", do))
    return found


def cluster_data(
    record: xr.Dataset,
    base: Cluster,
    structure: Structure,
    priors: Sequence[Prior],
    channels: Sequence[str],
    latent: Latent,
    until: float | None = None,
    names: Sequence[str] | None = None,
) -> FlightData:
    """Data of a cluster flight.

    Interpolated samples are not used (`measured`). Riser tensions are used after three times the risers' time constant
    c/k: a simulated flight begins with risers stretched as in equilibrium in the recorded wind, a real one in gusts,
    and the two agree only after that time.

    Args:
        record: Uniform record with ``capsule_position``, ``capsule_velocity``, ``canopy_position`` and ``density``:
            they give the initial state, whatever is fitted.
        base: Numbers that are not parameters.
        structure: Terms and options.
        priors: Priors of the parameters, in order.
        channels: Channels to fit; those the record lacks are left out.
        latent: Processes of the latent disturbances.
        until: Data after this time are held out [s].
        names: Names of the parameters in this flight, as in `with_parameters`: empty for one that is not used here;
            None: the names of the priors.

    Returns:
        The data.

    Raises:
        InputError: If a variable is missing, a channel is unknown or the canopies are missing in the first samples.
    """
    needed = ("capsule_position", "capsule_velocity", "canopy_position", "density")
    missing = [name for name in needed if name not in record]
    if missing:
        wanted = "capsule_position, capsule_velocity, canopy_position, density"
        raise InputError(
            Fault("record of a cluster", f"no {', '.join(missing)}", wanted, "Map the columns in the study file.")
        )
    time, n = record["time"].values.astype(float), structure.canopies
    dt = float(time[1] - time[0])
    samples = time.size
    apart = (record["canopy_position"] - record["capsule_position"]).transpose("time", "canopy", "axis").values
    velocity = record["capsule_velocity"].values
    recorded = "capsule_attitude" in record and bool(np.isfinite(record["capsule_attitude"].values).any())
    attitude = _attitude(record, apart, recorded)
    start, scatter = _start(record, base, time, apart, attitude)
    wind = filled(record["wind"].values, "wind") if "wind" in record else np.zeros((samples, 3))
    inputs = ClusterInputs(wind, filled(record["density"].values, "density"), np.ones((samples, n)), attitude)
    used = fitted_channels(record, channels)
    names = tuple(p.name for p in priors) if names is None else tuple(names)
    shares = tuple(p.air_share for p in priors)
    flight = ClusterFlight(
        base, start, tangent_basis(start.direction), inputs, dt, structure, names, used,
        air_shares=shares if APPARENT_MASS in names and any(shares) else (),
    )  # fmt: skip
    # Stiff lines and light canopies make the fastest pole; where lines hardly damp, it swings.
    tail = {name: -3.0 if name == APPARENT_MASS else 3.0 for name in LOGARITHMIC}
    tails = tail, tail | {"riser_damping": -3.0}
    stiff = [np.array([p.centre + tail.get(p.name, 0.0) * p.scale for p in priors]) for tail in tails]
    alone, own = flight.with_own_parameters()  # of one kind, whatever other flights have
    found = poles(alone, [theta[list(own)] for theta in stiff], 9 + 4 * n)
    flight = replace(flight, stepping=steps(found, dt))

    columns = {"canopy_position": apart.reshape(samples, -1), "capsule_velocity": velocity}
    columns |= {c: record[c].values.reshape(samples, -1) for c in used if c not in (*columns, "capsule_attitude")}
    if "riser_tension" in columns:
        settled = time - time[0] > _SETTLED * base.risers.damping / base.risers.stiffness
        columns["riser_tension"] = np.where(settled[:, None], columns["riser_tension"], np.nan)
    if recorded:
        columns["capsule_attitude"] = np.where(
            np.isfinite(record["capsule_attitude"].values[:, :1]), 0.0, np.nan
        ) * np.ones(3)
    observed = np.concatenate([np.where(_measured(record, c, n), columns[c], np.nan) for c in used], axis=1)
    sizes = channel_sizes(used, n)
    numbers = tuple(i for i, c in enumerate(channels) if c in used for _ in range(sizes[c]))
    gapless = (filled(a, where) for a, where in ((velocity, "capsule_velocity"), (apart, "canopy_position")))
    seen, hung = gapless
    path = record_path(start, base, dt, seen, attitude, hung)
    scale = _start_scale(n, recorded, scatter)
    return flight_data(flight, time, observed, numbers, latent, scale, until, path)


def _measured(record: xr.Dataset, channel: str, n: int) -> NDArray[np.bool_]:
    """Which samples of a channel are measurements (T, C); of the canopies' positions, where the capsule's are too.

    Positions are fitted relative to the capsule; velocities of canopies over ground need nothing of it.
    """
    dims = VARIABLES[channel].dims
    if "canopy" not in dims:
        return measured(record, channel)[:, None]
    each = np.stack([measured(record, f"{channel}.{i + 1}") for i in range(n)], axis=1)
    if channel == "canopy_position":
        each &= measured(record, "capsule_position")[:, None]
    return np.repeat(each, 3, axis=1) if "axis" in dims else each


def flight_data(
    model: FlightModel,
    time: Array,
    observed: Array,
    channel: tuple[int, ...],
    latent: Latent,
    start_scale: Array,
    until: float | None,
    path: RecordPath | None = None,
) -> FlightData:
    """Mask of the fitted data, without gaps and everything after `until` [s]."""
    present = np.isfinite(observed)
    if until is not None:
        present &= (time <= until)[:, None]
    return FlightData(
        model,
        np.where(present, observed, 0.0),
        present,
        float(time[1] - time[0]),
        start_scale,
        channel,
        latent,
        path,
    )


class _Scatter(NamedTuple):
    """Scatter of the first samples about the reference initial state; the rate's is None where none was recorded."""

    velocity: float
    rate: float | None
    direction: float


def _start_scale(n: int, attitude: bool, scatter: _Scatter) -> Array:
    """Prior standard deviations of the initial deviations, wide compared with the scatter of the first samples.

    Values for a capsule under long risers are too small for a small one that rocks within the first samples, or whose
    canopy positions are less accurate relative to the length of its risers.
    """
    direction = max(0.01, _WIDE * scatter.direction)
    by_kind = {"velocity": max(0.5, _WIDE * scatter.velocity), "attitude": 0.02 if attitude else 0.1}
    by_kind |= {"rate": 0.2 if scatter.rate is None else max(0.02, _WIDE * scatter.rate)}
    by_kind |= {"direction": direction, "turning": max(0.02, direction / _FIRST)}
    return np.array([by_kind[name.split(".")[0]] for name in deviation_names(n)])


def _attitude(record: xr.Dataset, apart: Array, recorded: bool) -> Array:
    """Recorded attitude with gaps filled, or upright along the mean riser where none was recorded (T, 4)."""
    if recorded:
        q = filled(record["capsule_attitude"].values, "capsule_attitude")
        return q / np.linalg.norm(q, axis=1, keepdims=True)
    axis = filled(apart.mean(axis=1), "canopy_position")
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    # Shortest turn from "body x up": q = (up x axis turn) after the quarter turn that lifts body x.
    w, v = 1.0 - axis[:, 2], np.cross(np.array([0.0, 0.0, -1.0]), axis)
    half = np.sqrt(0.5)
    q = half * np.stack([w - v[:, 1], v[:, 0] - v[:, 2], w + v[:, 1], v[:, 2] + v[:, 0]], axis=1)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def _start(record: xr.Dataset, base: Cluster, time: Array, apart: Array, attitude: Array) -> tuple[Start, _Scatter]:
    """Reference initial state of a record from the values and slopes of its first samples, and their scatter."""
    b = base.capsule.attach_b
    q = quaternion(attitude.T)
    attach = np.stack([np.asarray(c) for c in _ned(q, Vec3(b.x, b.y, b.z))], axis=1)
    riser = apart - attach[:, None]
    direction = riser / np.linalg.norm(riser, axis=-1, keepdims=True)
    n0, turning, aside = initial_motion(time, direction)
    if not np.isfinite(n0).all():
        got = f"no canopy position in the first {_FIRST:g} s"
        raise InputError(Fault("record of a cluster", got, "every canopy seen there", "Move the start of the window."))
    n0 /= np.linalg.norm(n0, axis=-1, keepdims=True)
    turning = turning - n0 * np.sum(n0 * turning, axis=-1, keepdims=True)
    velocity = initial_motion(time, filled(record["capsule_velocity"].values, "capsule_velocity"))
    rate, shaking = np.zeros(3), None
    if "capsule_rate" in record:
        seen = initial_motion(time, record["capsule_rate"].values)
        rate = np.where(np.isfinite(seen.value), seen.value, 0.0)
        shaking = _typical(seen.scatter)
    position = filled(record["capsule_position"].values, "capsule_position")[0]
    start = Start(position, velocity.value, attitude[0], rate, n0.T, turning.T)
    return start, _Scatter(_typical(velocity.scatter), shaking, _typical(aside))


def _typical(scatter: Array) -> float:
    """Root mean square over columns; zero where none has a value."""
    seen = scatter[np.isfinite(scatter)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else 0.0


def _ned(q: Quaternion, v: Vec3) -> tuple[Component, Component, Component]:
    turned = q.to_ned(Vec3(*(np.full(np.shape(q.w), float(c)) for c in (v.x, v.y, v.z))))
    return turned.x, turned.y, turned.z


def density_profile(altitude: Array, density: Array) -> DensityProfile:
    """Density by altitude from a record's samples: bin means of the logarithm, gaps interpolated, slopes continued.

    Args:
        altitude: (T,) [m].
        density: (T,) [kg/m^3].
    """
    present = np.isfinite(altitude) & np.isfinite(density)
    h, log_rho = altitude[present], np.log(density[present])
    lowest = np.floor(h.min() / _ALTITUDE_STEP) * _ALTITUDE_STEP
    nodes = lowest + _ALTITUDE_STEP * np.arange(max(int(np.ceil((h.max() - lowest) / _ALTITUDE_STEP)), 2) + 1)
    smooth = np.polynomial.Polynomial.fit(h, log_rho, 3 if np.ptp(h) > 3000.0 else 1)
    near = np.rint((h - lowest) / _ALTITUDE_STEP).astype(int)
    residual = log_rho - smooth(h)
    counts = np.bincount(near, minlength=nodes.size)
    mean = np.bincount(near, residual, minlength=nodes.size) / np.maximum(counts, 1)
    seen = counts > 0
    return DensityProfile(lowest, _ALTITUDE_STEP, smooth(nodes) + np.interp(nodes, nodes[seen], mean[seen]))


def descent_data(record: xr.Dataset, latent: Latent, until: float | None = None) -> FlightData:
    """Data of a descent.

    Args:
        record: Uniform record with ``altitude``, ``descent_rate`` and ``density``.
        latent: Processes of the vertical wind error.
        until: Data after this time are held out [s].

    Returns:
        The data; the single channel is the descent rate, interpolated samples absent (`measured`).

    Raises:
        InputError: If a variable is missing or empty.
    """
    missing = [name for name in ("altitude", "descent_rate", "density") if name not in record]
    if missing:
        wanted = "altitude, descent_rate and density, or what they derive from"
        raise InputError(
            Fault("record of a descent", f"no {', '.join(missing)}", wanted, "Map the columns in the study file.")
        )
    time, altitude = record["time"].values.astype(float), record["altitude"].values
    profile = density_profile(altitude, record["density"].values)
    recorded = record["descent_rate"].values
    rate = np.where(measured(record, "descent_rate"), recorded, np.nan)
    wind = record["wind"].values[:, 2] if "wind" in record else np.zeros(time.size)
    first = filled(recorded, "descent_rate")[:5]
    dt = float(time[1] - time[0])
    steps = max(2, int(np.ceil(dt / 0.25)))
    model = DescentFlight(
        profile,
        DescentInputs(wind),
        float(filled(altitude, "altitude")[0]),
        float(np.median(first)),
        dt,
        stepping=Stepping(steps),
    )
    return flight_data(model, time, rate[:, None], (0,), latent, np.array([2.0]), until)
