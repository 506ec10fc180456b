"""Modes of a cluster along its record: a label per window, and aerodynamic coefficients from each stretch of a mode."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayeschute.core.errors import InputError
from bayeschute.records.reconstruct import ClusterGeometry
from bayeschute.reduced.cluster_mode_laws import Canopy
from bayeschute.reduced.mode_coefficients import (
    ModeCoefficients,
    breathing_peak,
    flyout_coefficients,
    maypole_coefficients,
    pendulum_coefficients,
)
from bayeschute.reduced.mode_labels import WindowLabel, label_windows
from bayeschute.reduced.pendulum import Pendulum
from bayeschute.swing.modal import fit_swing
from bayeschute.swing.spectrum import Peak

if TYPE_CHECKING:
    import xarray as xr

BREATHING_BAND = (0.17, 0.6)  # of large canopies: above twice the pendulum's frequency [Hz]


_DOUBTFUL = "too few effective draws: take a longer stretch"


class Stretch(NamedTuple):
    """Consecutive windows of one label.

    Attributes:
        label: Of the windows.
        start: [s].
        end: [s].
        coefficients: Coefficients from it; None for a glide or a steady descent.
        reason: Why there are none where there should be, or why they are doubtful.
    """

    label: str
    start: float
    end: float
    coefficients: ModeCoefficients | None
    reason: str


class ClusterModes(NamedTuple):
    """Modes of a record.

    Attributes:
        labels: By window.
        stretches: In order of time; neighbours overlap where windows do.
        breathing: Of the riser tensions over the whole record, and their spectral peak; None where it can't be fitted.
        breathing_reason: Why not, or why it is doubtful.
    """

    labels: list[WindowLabel]
    stretches: list[Stretch]
    breathing: tuple[ModeCoefficients, Peak] | None
    breathing_reason: str


def stretches_of(labels: list[WindowLabel]) -> list[tuple[str, float, float]]:
    """Label, start and end of every run of windows with one label."""
    out: list[tuple[str, float, float]] = []
    for window in labels:
        if out and out[-1][0] == window.label:
            out[-1] = (window.label, out[-1][1], window.end)
        else:
            out.append((window.label, window.start, window.end))
    return out


def cluster_modes(
    record: xr.Dataset,
    made: xr.Dataset,
    geometry: ClusterGeometry,
    *,
    length: float = 15.0,
    seed: int = 0,
) -> ClusterModes:
    """Label a record's windows and identify its modes.

    Args:
        record: Uniform, with ``canopy_position``, ``capsule_position`` and ``density``.
        made: Motion by `bayeschute.records.reconstruct.reconstruct`.
        geometry: The vehicle.
        length: Of the windows [s].
        seed: Of the draws.

    Returns:
        Labels, stretches with coefficients, breathing.

    Raises:
        InputError: As `label_windows`.
    """
    time = made["time"].values.astype(float)
    direction = made["riser_direction"].values
    labels = label_windows(time, direction, made["air_velocity"].values, length=length)
    dt, found = float(np.median(np.diff(time))), []
    for label, start, end in stretches_of(labels):
        here = (time >= start - 1e-9) & (time < end - 1e-9)
        coefficients, reason = None, ""
        try:
            coefficients = _identified(label, record.isel(time=here), made.isel(time=here), geometry, dt, seed)
            reason = "" if coefficients is None or _trusted(coefficients) else _DOUBTFUL
        except InputError as error:
            reason = str(error)
        found.append(Stretch(label, start, end, coefficients, reason))
    try:
        tension = made["riser_tension"].mean("canopy", skipna=False).values
        breathing = breathing_peak(tension, dt, BREATHING_BAND, nuisance=_swing_squared(made, dt), seed=seed)
        reason = "" if _trusted(breathing[0]) else _DOUBTFUL
    except InputError as error:
        breathing, reason = None, str(error)
    return ClusterModes(labels, found, breathing, reason)


def _trusted(coefficients: ModeCoefficients) -> bool:
    return coefficients.swing is None or coefficients.swing.trusted


def _swing_squared(made: xr.Dataset, dt: float) -> np.ndarray:
    """Products of the swing's components and their rates (T, 6): a swing loads the risers twice per cycle."""
    across = made["riser_direction"].transpose("time", "canopy", "axis").values[:, :, :2].mean(axis=1)
    index = np.arange(len(across))
    filled = [np.interp(index, np.flatnonzero(np.isfinite(c)), c[np.isfinite(c)]) for c in across.T]
    products = [filled[0] ** 2, filled[1] ** 2, filled[0] * filled[1]]
    return np.stack([*products, *(np.gradient(p, dt) for p in products)], axis=1)


def _identified(
    label: str, record: xr.Dataset, made: xr.Dataset, geometry: ClusterGeometry, dt: float, seed: int
) -> ModeCoefficients | None:
    """Coefficients of one stretch."""
    position = record["canopy_position"].transpose("time", "canopy", "axis").values
    apart = position - record["capsule_position"].transpose("time", "axis").values[:, None]
    distance = float(np.nanmean(np.linalg.norm(apart, axis=2)))
    mass = geometry.dry_mass + float(np.nanmean(record["density"].values)) * geometry.enclosed_volume
    canopy = Canopy(mass, geometry.dry_mass * geometry.gravity, distance)
    q_area = made["dynamic_pressure"].mean("canopy", skipna=False).values * geometry.reference_area
    across = made["riser_direction"].transpose("time", "canopy", "axis").values[:, :, :2]
    if label == "flyout":
        return flyout_coefficients(made["flyout_angle"].values, q_area, dt, canopy, seed=seed)
    if label == "maypole":
        away = position[:, 0, :2] - position[:, :, :2].mean(axis=1)
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        return maypole_coefficients(azimuth, np.linalg.norm(away, axis=1), q_area, dt, canopy, seed=seed)
    if label == "pendulum":
        count = position.shape[1]
        swing = fit_swing(across.mean(axis=1), dt, observed="angle", settle=False, seed=seed)
        weight = (geometry.capsule_mass + count * geometry.dry_mass) * geometry.gravity
        axial = float(np.nanmedian(made["C_A"].values))
        system = Pendulum(weight, count * canopy.weight, count * mass, distance, geometry.gravity, axial)
        return pendulum_coefficients(swing, system)
    return None
