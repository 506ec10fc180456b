"""Reconstruction of a cluster's motion and forces from its record (report 6.1 and 6.3.5, with its errors corrected)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import STANDARD_GRAVITY
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.angles import across, airflow, dot, flyout_angle, proximity, swing_angle, unit, wind_axes
from bayeschute.records.derive import measured, sea_level_rate, smoothing_window, uniform_interval
from bayeschute.records.differentiate import savitzky_golay
from bayeschute.records.record import AXIS, Repair, values_of, with_repairs
from bayeschute.records.smoothing import SHORTEST, fourier_smooth

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
Method = Literal["fourier", "local"]

_SINGULAR = 1e-2  # risers closer to parallel than this (rad, about) share the pull evenly
_WINDOW = 1.0  # length of the local quadratics [s]


@dataclass(frozen=True)
class ClusterGeometry:
    """What a reconstruction needs to know of the vehicle; all canopies alike.

    Attributes:
        reference_length: l, also D_o of the proximity [m].
        reference_area: S of one canopy [m^2].
        dry_mass: m_d of one canopy [kg].
        enclosed_volume: V_ea of one canopy [m^3].
        capsule_mass: m_c [kg].
        capsule_reference_area: S_c [m^2].
        capsule_drag_coefficient: Drag along the relative wind over q S_c.
        attach_b: Attach point of the risers from the capsule's centre of mass, body axes [m].
        gravity: [m/s^2].
    """

    reference_length: float
    reference_area: float
    dry_mass: float
    enclosed_volume: float
    capsule_mass: float
    capsule_reference_area: float = 0.0
    capsule_drag_coefficient: float = 0.0
    attach_b: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: float = STANDARD_GRAVITY


UNITS = {
    "canopy_velocity": "m/s",
    "canopy_acceleration": "m/s^2",
    "riser_direction": "1",
    "riser_direction_rate": "1/s",
    "riser_length": "m",
    "air_velocity": "m/s",
    "airspeed": "m/s",
    "dynamic_pressure": "Pa",
    "beta": "rad",
    "alpha": "rad",
    "alpha_T": "rad",
    "phi_a": "rad",
    "beta_rate": "rad/s",
    "alpha_rate": "rad/s",
    "alpha_T_rate": "rad/s",
    "phi_a_rate": "rad/s",
    "D_prox": "1",
    "V_prox": "1/s",
    "phi_prox": "rad",
    "riser_tension": "N",
    "C_A": "1",
    "C_Y": "1",
    "C_N": "1",
    "c_t": "1",
    "swing_angle": "rad",
    "flyout_angle": "rad",
    "descent_rate": "m/s",
    "sea_level_descent_rate": "m/s",
}
_BY_ACCELERATION = (
    "canopy_acceleration", "beta_rate", "alpha_rate", "alpha_T_rate", "phi_a_rate", "C_A", "C_Y", "C_N", "c_t",
)  # fmt: skip


def _runs(present: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(np.int8), [0]])))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def smooth_motion(x: Array, dt: float, method: Method = "fourier") -> tuple[Array, Array]:
    """First and second derivatives of series with gaps.

    Args:
        x: Samples (T, ...) at a uniform rate; NaN where missing.
        dt: Sample interval [s].
        method: ``"fourier"``: global Fourier smoothing of every stretch without gaps (of 20 samples or more);
            ``"local"``: quadratics over 1 s, applied twice for the second derivative.

    Returns:
        dx/dt and d2x/dt2, same shape; NaN where they can't be had.

    Raises:
        InputError: On an unknown method or a record shorter than the window.
    """
    if method == "local":
        window = smoothing_window(dt, _WINDOW)
        first = savitzky_golay(x, dt, window)
        return first, savitzky_golay(first, dt, window)
    if method != "fourier":
        raise InputError(Fault("reconstruction, method", repr(method), "'fourier' or 'local'"))
    columns = x.reshape(x.shape[0], -1)
    first, second = np.full_like(columns, np.nan), np.full_like(columns, np.nan)
    for c, column in enumerate(columns.T):
        for run in _runs(np.isfinite(column)):
            if run.stop - run.start >= SHORTEST:
                smoothed = fourier_smooth(column[run], dt)
                first[run, c], second[run, c] = smoothed.first, smoothed.second
    return first.reshape(x.shape), second.reshape(x.shape)


def to_ned(attitude: Array, v_b: Array) -> Array:
    """Components from body to NED.

    Args:
        attitude: Unit quaternions from NED to body (T, 4).
        v_b: Vectors in body axes (T, 3) or (3,).

    Returns:
        (T, 3), in the unit of `v_b`.
    """
    w, q = attitude[:, :1], attitude[:, 1:]
    twice = 2.0 * np.cross(q, np.broadcast_to(v_b, q.shape))
    return np.asarray(v_b + w * twice + np.cross(q, twice))


def riser_tensions(pull: Array, direction: Array) -> Array:
    """Sizes of the risers' pulls from their sum (figure 6.1-6): least squares, least norm where risers are parallel.

    Args:
        pull: Sum of the pulls on the capsule (T, 3) [N].
        direction: Riser directions, capsule to canopy (T, n, 3).

    Returns:
        (T, n) [N].
    """
    out = np.full(direction.shape[:2], np.nan)
    good = np.isfinite(pull).all(axis=1) & np.isfinite(direction).all(axis=(1, 2))
    if good.any():
        inverse = np.linalg.pinv(np.swapaxes(direction[good], 1, 2), rcond=_SINGULAR)
        out[good] = np.einsum("tij,tj->ti", inverse, pull[good])
    return out


def _needed(record: xr.Dataset) -> float:
    """The sample interval of a record that has what is needed."""
    advice = {"density": "Derive it first (flight.derive)."}
    missing = [n for n in ("capsule_position", "canopy_position", "density") if n not in record]
    if missing:
        faults = [Fault("reconstruction", f"a record without {n}", "that variable", advice.get(n, "")) for n in missing]
        raise InputError(faults)
    return uniform_interval(record["time"].values, "reconstruction")


def _capsule_motion(record: xr.Dataset, dt: float, method: Method) -> tuple[Array, Array]:
    """Velocity and acceleration of the capsule, NED; from its position where no velocity is recorded."""
    if "capsule_velocity" in record:
        velocity = values_of(record, "capsule_velocity")
        return velocity, smooth_motion(velocity, dt, method)[0]
    return smooth_motion(values_of(record, "capsule_position"), dt, method)


def _attach(record: xr.Dataset, geometry: ClusterGeometry, position: Array, canopies: Array) -> Array:
    """Attach point from the capsule's centre of mass, NED (T, 3); along the mean riser where attitude is unknown."""
    attach_b = np.asarray(geometry.attach_b, dtype=float)
    if not attach_b.any():
        return np.zeros_like(position)
    if "capsule_attitude" in record:
        return to_ned(unit(values_of(record, "capsule_attitude")), attach_b)
    return unit(canopies.mean(axis=1) - position) * np.linalg.norm(attach_b)


def _pull(
    record: xr.Dataset, geometry: ClusterGeometry, velocity: Array, acceleration: Array, wind: Array, density: Array
) -> Array:
    """Sum of the risers' pulls on the capsule (T, 3) [N]: its non-gravitational force less its drag."""
    if "capsule_specific_force" in record and "capsule_attitude" in record:
        felt = to_ned(unit(values_of(record, "capsule_attitude")), values_of(record, "capsule_specific_force"))
    else:
        felt = acceleration - np.array([0.0, 0.0, geometry.gravity])
    relative = velocity - wind
    speed = np.linalg.norm(relative, axis=-1)
    drag_area = geometry.capsule_reference_area * geometry.capsule_drag_coefficient
    return geometry.capsule_mass * felt + (0.5 * density * speed * drag_area)[:, None] * relative


def force_coefficients(
    acceleration: Array, tension: Array, x: Array, air_velocity: Array, density: Array, geometry: ClusterGeometry
) -> dict[str, Array]:
    """Force coefficients of canopies (6.3.5-1, weight on the dry mass, inertia with the enclosed air).

    F = m a - m_d g - T x = q S (-C_A x + C_Y j - C_N k), j = k x x.

    Args:
        acceleration: Of the canopies (T, n, 3), NED [m/s^2].
        tension: (T, n) [N].
        x: Canopy axes, towards the capsule, unit.
        air_velocity: Velocity relative to the air [m/s].
        density: (T,) [kg/m^3].
        geometry: Masses and reference area.

    Returns:
        ``C_A``, ``C_Y``, ``C_N`` (T, n) and ``c_t`` (T, n, 3), the transverse part of F/(qS), NED. C_Y and C_N are NaN
        where alpha_T vanishes; c_t is not.
    """
    mass = geometry.dry_mass + density * geometry.enclosed_volume
    weight = np.array([0.0, 0.0, geometry.dry_mass * geometry.gravity])
    force = mass[:, None, None] * acceleration - weight - tension[..., None] * x
    q_area = 0.5 * density[:, None] * dot(air_velocity, air_velocity) * geometry.reference_area
    c = force / np.where(q_area > 0.0, q_area, np.nan)[..., None]
    j, k = wind_axes(air_velocity, x)
    return {"C_A": -dot(c, x), "C_Y": dot(c, j), "C_N": -dot(c, k), "c_t": across(c, x)}


def _doubtful(record: xr.Dataset, time: Array, n: int, trim: float) -> NDArray[np.bool_]:
    """Samples (T, n) whose accelerations are no measurement: interpolated, or close to an end of a stretch."""
    canopies = values_of(record, "canopy_position")
    doubtful = np.zeros((time.size, n), bool)
    for i in range(n):
        for run in _runs(np.asarray(np.isfinite(canopies[:, i]).all(axis=1))):
            t = time[run]
            doubtful[run, i] |= (t < t[0] + trim - 1e-9) | (t > t[-1] - trim + 1e-9)
        doubtful[:, i] |= ~measured(record, f"canopy_position.{i + 1}")
    return doubtful


def reconstruct(
    record: xr.Dataset,
    geometry: ClusterGeometry,
    method: Method = "fourier",
    trim: float = 1.0,
    canopy_wind: Array | None = None,
) -> xr.Dataset:
    """Motion, airflow, angles, riser tensions and force coefficients of every canopy along a record.

    Args:
        record: Uniform record with ``capsule_position``, ``canopy_position`` and ``density``; better with
            ``capsule_velocity``, ``capsule_attitude``, ``capsule_specific_force`` and ``wind``. A recorded
            ``riser_tension`` is used as it is.
        geometry: The vehicle.
        method: How positions are differentiated, see `smooth_motion`.
        trim: Accelerations and what follows from them are left NaN so long beside every end of a stretch without
            gaps, where second derivatives ring [s]; and where positions were interpolated.
        canopy_wind: Wind of the canopies less that of the capsule (T, n, 3), NED [m/s]; None: they are the same.

    Returns:
        A Dataset with the variables of `UNITS` over (time, canopy, axis), (time, canopy) or (time); its ``repairs``
        are the record's and what was assumed here.

    Raises:
        InputError: If a variable is missing, the rate is not uniform or the record is too short.
    """
    import xarray as xr

    dt = _needed(record)
    time = record["time"].values.astype(float)
    position, canopies = values_of(record, "capsule_position"), values_of(record, "canopy_position")
    density, n = values_of(record, "density"), canopies.shape[1]
    wind = values_of(record, "wind") if "wind" in record else np.zeros_like(position)
    velocity, acceleration = _capsule_motion(record, dt, method)

    riser = canopies - (position + _attach(record, geometry, position, canopies))[:, None]
    direction, length = unit(riser), np.linalg.norm(riser, axis=-1)
    x = -direction
    canopy_velocity, canopy_acceleration = smooth_motion(canopies, dt, method)
    x_dot = -across(smooth_motion(riser, dt, method)[0], direction) / length[..., None]
    aloft = wind[:, None] if canopy_wind is None else wind[:, None] + canopy_wind
    air_velocity = canopy_velocity - aloft
    air_acceleration = canopy_acceleration - _wind_rate(aloft, dt)
    flow = airflow(air_velocity, air_acceleration, x, x_dot)
    near = proximity(canopies, canopy_velocity, air_velocity, x, geometry.reference_length)
    if "riser_tension" in record:
        tension = values_of(record, "riser_tension")
    else:
        tension = riser_tensions(_pull(record, geometry, velocity, acceleration, wind, density), direction)

    speed = np.linalg.norm(air_velocity, axis=-1)
    out: dict[str, Array] = {
        "canopy_velocity": canopy_velocity,
        "canopy_acceleration": canopy_acceleration,
        "riser_direction": direction,
        "riser_direction_rate": -x_dot,
        "riser_length": length,
        "air_velocity": air_velocity,
        "airspeed": speed,
        "dynamic_pressure": 0.5 * density[:, None] * speed**2,
        **flow._asdict(),
        "D_prox": near.distance,
        "V_prox": near.closing,
        "phi_prox": near.angle,
        "riser_tension": tension,
        **force_coefficients(canopy_acceleration, tension, x, air_velocity, density, geometry),
        "swing_angle": swing_angle(riser),
        "flyout_angle": flyout_angle(riser),
        "descent_rate": velocity[:, 2],
        "sea_level_descent_rate": sea_level_rate(velocity[:, 2], density),
    }
    doubtful = _doubtful(record, time, n, trim)
    for name in _BY_ACCELERATION:
        out[name] = np.where(doubtful[..., None] if out[name].ndim == 3 else doubtful, np.nan, out[name])
    dims = ("time", "canopy", "axis")
    coords = {"time": ("time", time, {"units": "s"}), "canopy": np.arange(1, n + 1), "axis": list(AXIS)}
    data = {name: (dims[: values.ndim], values, {"units": UNITS[name]}) for name, values in out.items()}
    made = xr.Dataset(data, coords, {"repairs": record.attrs.get("repairs", "[]"), "differentiation": method})
    return with_repairs(made, _assumed(record, geometry, time))


def _wind_rate(wind: Array, dt: float) -> Array:
    """Rate of a wind by local quadratics over 1 s, shape of the wind (T, ...) [m/s^2]."""
    window = smoothing_window(dt, _WINDOW)
    return savitzky_golay(wind, dt, window) if wind.shape[0] >= window else np.zeros_like(wind)


def _assumed(record: xr.Dataset, geometry: ClusterGeometry, time: Array) -> list[Repair]:
    """What had to be assumed for want of a variable."""
    first, last, count = float(time[0]), float(time[-1]), time.size
    notes = []
    if "wind" not in record:
        notes.append(Repair("assumed", "wind", first, last, count, "not recorded: taken as still air"))
    if "capsule_attitude" not in record and any(geometry.attach_b):
        detail = "not recorded: attach point taken along the mean riser"
        notes.append(Repair("assumed", "capsule_attitude", first, last, count, detail))
    if "riser_tension" not in record and not {"capsule_specific_force", "capsule_attitude"} <= set(record.data_vars):
        detail = "not recorded in full: pull of the risers from the capsule's differentiated motion"
        notes.append(Repair("assumed", "capsule_specific_force", first, last, count, detail))
    return notes
