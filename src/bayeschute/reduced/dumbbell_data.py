"""From a record of a swing in one plane to data for the planar dumbbell (report 6.3.1, 7.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.core.errors import Fault, InputError
from bayeschute.likelihood.channels import filled, flight_data, initial_motion
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData
from bayeschute.likelihood.priors import Prior
from bayeschute.reduced.dumbbell import CHANNELS, Dumbbell, DumbbellFlight, DumbbellInputs
from bayeschute.reduced.planar import PlanarAero

START_SCALE = np.array([0.02, 0.03, 0.5, 0.5])
"""Prior standard deviations of the initial deviations, as `dumbbell.DEVIATIONS`; SI."""
STILL = Latent((), (), 2)
"""No latent disturbances: classical output error."""
GUSTS = Latent(("drift", "drift"), ((0, 0), (1, 1)))
"""Latent error of the wind: one Ornstein-Uhlenbeck process along, one down."""
WIND = Latent(("drift",) * 4, ((0, 0), (1, 1), (0, 2), (1, 3)))
"""Likewise gusts along and down, then the slow error of the recorded wind along and down."""


def dumbbell_data(
    record: xr.Dataset,
    base: Dumbbell,
    aero: PlanarAero,
    priors: Sequence[Prior],
    latent: Latent = STILL,
    channels: Sequence[str] = ("swing_angle", "capsule_velocity"),
    until: float | None = None,
    substeps: int = 2,
) -> FlightData:
    """Data of a planar swing.

    Args:
        record: Uniform planar record: ``swing_angle``, ``capsule_velocity``, ``density``, and ``wind`` where known.
        base: Masses and sizes that are not parameters.
        aero: Coefficients that are not parameters.
        priors: Priors of the parameters, named as fields of `PlanarAero`, ``capsule_mass`` or ``length``, in SI and on
            the values themselves.
        latent: Processes of the wind error, along and down: `STILL`, `GUSTS` or `WIND`.
        channels: Outputs to fit, of `dumbbell.CHANNELS`; ``air_velocity`` is velocity less recorded wind.
        until: Data after this time are held out [s].
        substeps: Runge-Kutta steps per sample.

    Returns:
        The data; the noise has one channel per entry of `channels`.

    Raises:
        InputError: If a variable is missing, a channel is unknown, or a prior is on a logarithm.
    """
    missing = [n for n in ("swing_angle", "capsule_velocity", "density") if n not in record]
    faults = [Fault("record of a swing", f"no {name}", "swing_angle, capsule_velocity, density") for name in missing]
    faults += [Fault("channels", repr(c), " or ".join(CHANNELS)) for c in channels if c not in CHANNELS]
    faults += [Fault(f"prior of {p.name}", "a logarithm", "the value itself") for p in priors if p.logarithmic]
    if faults:
        raise InputError(faults)
    time = record["time"].values.astype(float)
    swing, velocity = record["swing_angle"].values, record["capsule_velocity"].values
    wind = filled(record["wind"].values, "wind") if "wind" in record else np.zeros((time.size, 2))
    inputs = DumbbellInputs(wind, filled(record["density"].values, "density"))
    measured = filled(np.column_stack([swing, velocity]), "swing_angle and capsule_velocity")
    value, slope, _ = initial_motion(time, measured)
    start = np.array([0.0, 0.0, value[1], value[2], value[0], slope[0]])
    names = tuple(p.name for p in priors)
    model = DumbbellFlight(
        base, aero, start, inputs, float(time[1] - time[0]), names, tuple(channels), Stepping(substeps)
    )
    columns = {"swing_angle": swing[:, None], "capsule_velocity": velocity, "air_velocity": velocity - wind}
    observed = np.concatenate([columns[c] for c in channels], axis=1)
    numbers = tuple(i for i, c in enumerate(channels) for _ in range(CHANNELS[c]))
    return flight_data(model, time, observed, numbers, latent, START_SCALE, until)
