"""Structure of the canopies' aerodynamics from a reconstructed record: vector equation error on equivariant terms.

The terms are those of `bayeschute.aero.terms`, evaluated along the record exactly as the simulator evaluates them at a
state, so the selected structure goes into the simulator unchanged. The axial coefficient is a scalar regression, the
transverse one a vector regression: both components across the canopy axis at once, no azimuth (PHYSICS 3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.aero.terms import axial_term, transverse_term
from bayeschute.air.airflow import SEA_LEVEL_DENSITY, CanopyFlow, neighbours, squared_angle
from bayeschute.air.vector import Vec3, dot
from bayeschute.errors import Fault, InputError
from bayeschute.flight.smoothing import fourier_smooth
from bayeschute.regression.diagnostics import autocorrelation, collinearity, null_models
from bayeschute.regression.equation_error import EquationErrorFit, Stack, fit, refit, stack_components, stack_records
from bayeschute.regression.orthogonal import Selection, select
from bayeschute.regression.prediction import predict_record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Identified:
    """What equation error found for one coefficient.

    Attributes:
        selection: The path of the selection.
        fit: Least squares of the kept terms.
        report: The entry of ``structure.json``.
    """

    selection: Selection
    fit: EquationErrorFit
    report: dict[str, Any]


def flow_along(record: xr.Dataset, made: xr.Dataset, length: float, speed: float) -> CanopyFlow:
    """The airflow of every canopy along a record.

    Args:
        record: Uniform record with ``canopy_position``.
        made: What `bayeschute.flight.reconstruct` made of it.
        length: Reference length l [m].
        speed: Reference speed V_o [m/s].

    Returns:
        The flow, arrays (canopy, T); the rate is the riser's.
    """

    def vectors(values: Any) -> Vec3:
        return Vec3(*np.moveaxis(np.asarray(values), (0, 1, 2), (2, 1, 0)))  # (T, canopy, 3) -> 3 of (canopy, T)

    axis = -vectors(made["riser_direction"].values)
    airspeed = made["airspeed"].values.T
    w = vectors(made["air_velocity"].values) / airspeed
    cosine = dot(w, axis)
    e = w - axis * cosine
    x_dot = -vectors(made["riser_direction_rate"].values)
    reference = 0.5 * SEA_LEVEL_DENSITY * speed**2
    position, velocity = vectors(record["canopy_position"].values), vectors(made["canopy_velocity"].values)
    q = made["dynamic_pressure"].values.T
    return CanopyFlow(
        axis=axis,
        e=e,
        rate=-x_dot * (cosine * length / (2.0 * airspeed)),
        alpha_squared=squared_angle(dot(e, e), cosine),
        cos_alpha=cosine,
        q=q,
        q_ratio=q / reference,
        speed_ratio=airspeed / speed - 1.0,
        neighbours=neighbours(position, velocity, axis, length, airspeed.shape[0]),
    )


def _across(axis: Vec3) -> tuple[Array, Array]:
    """Two unit vectors across the canopy axes, (3, canopy, T): nearest to north, and x cross that."""
    x = np.stack([np.asarray(c) for c in (axis.x, axis.y, axis.z)])
    first = np.array([1.0, 0.0, 0.0])[:, None, None] - x * x[:1]
    first /= np.linalg.norm(first, axis=0)
    return first, np.cross(x, first, axis=0)


def axial_problem(names: Sequence[str], flow: CanopyFlow, made: xr.Dataset, canopy: int) -> Stack:
    """Regressors and data of the axial coefficient of one canopy (from 0)."""
    columns = [np.broadcast_to(np.asarray(axial_term(name, flow)), flow.q.shape)[canopy] for name in names]
    x = np.stack(columns, axis=1)[:, None, :]
    return stack_components(x, made["C_A"].values[:, canopy, None])


def transverse_problem(names: Sequence[str], flow: CanopyFlow, made: xr.Dataset, canopy: int) -> Stack:
    """Regressors and data of the transverse coefficient of one canopy (from 0), two components stacked."""
    first, second = _across(flow.axis)

    def components(vector: Array) -> Array:
        return np.stack([np.sum(vector * b[:, canopy], axis=0) for b in (first, second)], axis=1)

    columns = []
    for name in names:
        term = transverse_term(name, flow)
        columns.append(components(np.stack([np.asarray(c)[canopy] for c in (term.x, term.y, term.z)])))
    return stack_components(np.stack(columns, axis=2), components(made["c_t"].values[:, canopy].T))


def colored_variance(stack: Stack, names: Sequence[str]) -> float:
    """The noise level that selection must beat: residual variance of the whole pool, times its correlation time.

    A useless regressor gains sigma^2/N from white noise, but that times the number of samples over which noise stays
    correlated from colored noise. The floor that smoothing finds knows only the white part; with it, any pool is kept
    whole.
    """
    labels = (stack.blocks, stack.groups, stack.components)
    everything = fit(stack.X, stack.z, list(names), blocks=labels[0], groups=labels[1], components=labels[2])
    return everything.rms**2 * max(everything.autocorrelation_time, 1.0)


def _signal_to_noise(stack: Stack, dt: float) -> float:
    """Mean signal-to-noise ratio of the data by global Fourier smoothing of each series."""
    snr = []
    for series in np.unique(stack.blocks):
        z = stack.z[stack.blocks == series]
        run = _longest_run(np.isfinite(z))
        if run.stop - run.start >= 40:
            snr.append(fourier_smooth(z[run], dt).snr)
    if not snr:
        wanted = "a stretch of 40 samples without a gap"
        raise InputError(
            Fault("equation error", "no such stretch", wanted, "Use a longer window or a record with fewer dropouts.")
        )
    return float(np.mean(snr))


def _longest_run(present: NDArray[np.bool_]) -> slice:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(int), [0]])))
    starts, stops = edges[::2], edges[1::2]
    if not starts.size:
        return slice(0, 0)
    best = int(np.argmax(stops - starts))
    return slice(int(starts[best]), int(stops[best]))


def identify(
    stacks: Sequence[Stack],
    names: Sequence[str],
    dt: float,
    ceiling: float,
    checks: Mapping[str, Stack],
    pressure: Array | None,
) -> Identified:
    """Select the structure of one coefficient and fit it.

    Args:
        stacks: Problems to identify on, one per canopy and flight.
        names: Candidates.
        dt: Sample interval [s].
        ceiling: sigma_max^2 as a multiple of `colored_variance`.
        checks: Problems on which the fit is tried, by label.
        pressure: Dynamic pressure of the rows [Pa], for the constant-force null model of C_A; None for vectors.

    Returns:
        The structure, its fit and the entry for ``structure.json``.

    Raises:
        InputError: If no candidate pays for itself.
    """
    snr = [_signal_to_noise(stack, dt) for stack in stacks]
    stack = stack_records(stacks)
    noise = colored_variance(stack, names)
    found = select(
        stack.X,
        stack.z,
        list(names),
        groups=stack.components,
        rule="fixed",
        sigma_max2=ceiling * noise,
        noise_variance=noise,
    )
    options = {"blocks": stack.blocks, "groups": stack.groups, "components": stack.components}
    fitted = refit(found, stack.X, stack.z, **options)
    kept = list(found.selected)
    near = collinearity(stack.X[:, kept], list(fitted.names))
    colored = autocorrelation(fitted.noise, dt)
    step = max(len(colored.lag) // 200, 1)
    nulls = null_models(stack.z, pressure, components=stack.components)
    null = nulls[-1]
    report: dict[str, Any] = {
        "selected": [
            {"term": name, "estimate": float(b), "se": float(s), "white_se": float(w), "unit": "1"}
            for name, b, s, w in zip(fitted.names, fitted.estimate, fitted.se, fitted.white_se, strict=True)
        ],
        "ranking": [{k: getattr(row, k) for k in row.__dataclass_fields__} for row in found.rows],
        "candidates": list(names),
        "snr": float(np.mean(snr)),
        "sigma_max2": ceiling * noise,
        "penalty_factor": 2.0,
        "pse_minimum_at": found.minimum,
        "sensitivity": [
            {"sigma_max2": s.sigma_max2, "low": s.low, "high": s.high, "terms": list(s.terms)}
            for s in found.sensitivity()
        ],
        "collinearity": {
            "max_correlation": near.max_correlation,
            "pair": list(near.pair),
            "max_vif": near.max_vif,
            "condition_index": near.condition_index,
            "flagged": list(near.flags),
        },
        "null_model": {"name": null.name, "r2": null.r2, "rms": null.rms},
        "residual": {
            "rms": fitted.rms,
            "autocorrelation_time": colored.integrated_time,
            "lag": colored.lag[::step].tolist(),
            "autocorrelation": colored.correlation[::step].tolist(),
        },
        "samples": int(np.sum(fitted.used)),
        "check": {
            label: {
                "rms_ratio": predict_record(
                    fitted, other.X[:, kept], other.z, label=label, components=other.components
                ).rms_ratio
            }
            for label, other in checks.items()
        },
    }
    return Identified(found, fitted, jax.tree.map(_plain, report))


def _plain(value: Any) -> Any:
    """A number as JSON can hold it: NaN and infinities become None."""
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    return float(value) if np.isfinite(value) else None
