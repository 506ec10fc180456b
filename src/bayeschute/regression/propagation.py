"""Propagation of position noise through differentiation to the coefficients, by simulation (SIMEX).

Forces need second derivatives of the canopies' positions, regressors first ones. White noise of the size that global
Fourier smoothing finds in the positions is added once more, everything is computed again, and the estimates change:
their spread is the part of the standard error that is due to the positions (to first order, the added noise contributes
as much as the noise that was there), and their mean shift estimates the bias that noisy regressors caused
(simulation-extrapolation, SIMEX; Cook & Stefanski 1994).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.smoothing import SHORTEST, fourier_smooth
from bayeschute.regression.noise_level import longest_run
from bayeschute.regression.stacked import Stack

Array = NDArray[np.float64]


class Propagated(NamedTuple):
    """Effect of the positions' noise on estimates.

    Attributes:
        position_sd: Standard deviation of the white noise of the canopies' positions [m].
        response_sd: What it makes of the response, rms over the rows [unit of z].
        sd: Spread of each coefficient, (n,).
        shift: Mean change of each coefficient when the noise is added once more, (n,); about the bias that it causes.
        replicates: Number of times.
    """

    position_sd: float
    response_sd: float
    sd: Array
    shift: Array
    replicates: int


def position_noise(record: xr.Dataset) -> float:
    """White noise of the canopies' positions by global Fourier smoothing of each component [m].

    Args:
        record: Uniform record with ``canopy_position``.

    Returns:
        Root mean square over canopies and components; 0 if no stretch without gaps is long enough.
    """
    time = record["time"].values
    columns = record["canopy_position"].transpose("time", ...).values.reshape(time.size, -1)
    found = []
    for column in columns.T:
        run = longest_run(np.isfinite(column))
        if run.stop - run.start >= 2 * SHORTEST:
            found.append(fourier_smooth(column[run], float(time[1] - time[0])).noise_sd ** 2)
    return float(np.sqrt(np.mean(found))) if found else 0.0


def propagate(
    records: Sequence[xr.Dataset],
    rebuild: Callable[[Sequence[xr.Dataset]], Mapping[str, Stack]],
    kept: Mapping[str, Sequence[int]],
    rng: np.random.Generator,
    replicates: int = 8,
) -> dict[str, Propagated]:
    """Add the positions' noise once more, several times, and fit the same terms again.

    Args:
        records: The records that the structure was found on.
        rebuild: From records to the regression of each coefficient, all candidates: reconstruction included.
        kept: Columns of the model of each coefficient.
        rng: Source of the noise.
        replicates: How often.

    Returns:
        The effect, by coefficient.

    Raises:
        InputError: If fewer than 2 replicates are requested.
    """
    if replicates < 2:
        raise InputError(Fault("noise propagation", f"{replicates} replicates", "at least 2"))
    sds = [position_noise(record) for record in records]
    base = rebuild(records)
    first = {name: _estimate(base[name], kept[name]) for name in kept}
    estimates: dict[str, list[Array]] = {name: [] for name in kept}
    responses: dict[str, list[float]] = {name: [] for name in kept}
    for _ in range(replicates):
        again = rebuild([_noisier(record, sd, rng) for record, sd in zip(records, sds, strict=True)])
        for name in kept:
            estimates[name].append(_estimate(again[name], kept[name]))
            responses[name].append(float(np.nanmean((again[name].z - base[name].z) ** 2)))
    position_sd = float(np.sqrt(np.mean(np.square(sds))))
    return {
        name: Propagated(
            position_sd=position_sd,
            response_sd=float(np.sqrt(np.mean(responses[name]))),
            sd=np.std(estimates[name], axis=0, ddof=1),
            shift=np.mean(estimates[name], axis=0) - first[name],
            replicates=replicates,
        )
        for name in kept
    }


def _noisier(record: xr.Dataset, sd: float, rng: np.random.Generator) -> xr.Dataset:
    positions = record["canopy_position"]
    noisy = record.assign(canopy_position=positions + sd * rng.standard_normal(positions.shape))
    noisy["canopy_position"].attrs = dict(positions.attrs)
    return noisy


def _estimate(stack: Stack, kept: Sequence[int]) -> Array:
    X = stack.X[:, list(kept)]
    used = np.isfinite(stack.z) & np.isfinite(X).all(axis=1)
    return np.asarray(np.linalg.lstsq(X[used], stack.z[used], rcond=None)[0])
