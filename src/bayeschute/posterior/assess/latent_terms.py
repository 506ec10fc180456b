"""What the latent forces of a fit follow: proposals for terms that its structure lacks.

A fit puts what no term explains into latent disturbances of the canopies' forces. Where one follows a candidate
regressor along the record, a term is likely to be missing. The regressor counts with what the terms of the model can't
make of it, by projection. The share of the disturbance's variance that it explains is the squared correlation about
zero; how likely so large a one is by chance is judged with the disturbance's own autocorrelation: samples of a slow
process are few independent ones (as equation error's standard errors are corrected for colored residuals; Morelli and
Klein 1997). Smoothed disturbances are estimates, drawn towards zero: this proposes, a fit with the term decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
_TAPER = 0.25  # of a series' length: greatest lag of a covariance that counts
_LEAST = 1e-6  # of a regressor's mean square, below which the terms of the model make all of it


class Proposal(NamedTuple):
    """A term that a latent force follows.

    Attributes:
        term: Its name.
        share: Of the latent force's variance that it explains, beyond what the model's terms could [1].
        coefficient: By least squares, of what the model's terms can't make of it [1].
        z: Coefficient over its standard error, autocorrelation counted.
        p_value: Two-sided, of one term by itself.
        p_any: That any of the candidates would reach this by chance, at most (Bonferroni).
    """

    term: str
    share: float
    coefficient: float
    z: float
    p_value: float
    p_any: float


def _spectra(series: Array) -> Array:
    """Fourier transforms (C, F) of series (C, T), padded so that products are not circular."""
    return np.asarray(np.fft.rfft(series, 1 << int(2 * series.shape[1] - 1).bit_length(), axis=1))


def variance_of_product(latent: Array, regressor: Array) -> float:
    """Variance of ``sum(latent * regressor)`` if the latent series are stationary and have nothing to do with it.

    Every pair of components counts with its cross-covariance, since canopies share their gusts. Covariances are biased
    estimates, tapered to zero by a triangle at a quarter of the series (Bartlett 1950): shorter ones call too much
    significant where the latent force is slow, as trials with known processes show.

    Args:
        latent: Components (C, T).
        regressor: Likewise.
    """
    components, length = latent.shape
    lag = np.arange(length)
    taper = np.maximum(1.0 - lag / (_TAPER * length + 1.0), 0.0) / length
    own, other = _spectra(latent), _spectra(regressor)
    size = 2 * (own.shape[1] - 1)
    total = 0.0
    for i in range(components):
        for j in range(components):
            both = np.fft.irfft(own[i] * own[j].conj(), size) * np.fft.irfft(other[i] * other[j].conj(), size)
            total += float(taper @ both[:length] + taper[1:] @ both[-1:-length:-1])
    return total


def proposals(
    latent: Sequence[Array], model: Mapping[str, Sequence[Array]], candidates: Mapping[str, Sequence[Array]]
) -> list[Proposal]:
    """Candidates by the share of a latent force that they explain, the strongest first.

    Args:
        latent: The disturbance of every flight: components of all canopies (C, T).
        model: Regressors of the model's terms by name: likewise.
        candidates: Regressors of terms that the model lacks: likewise.

    Returns:
        One proposal a candidate. Those that the model's terms make are left out, and all where nothing is disturbed.
    """
    y = np.concatenate([np.ravel(one) for one in latent])
    power = float(y @ y)
    if not power > 0.0:
        return []
    basis = np.zeros((y.size, 0))
    if model:
        columns = np.stack([np.concatenate([np.ravel(x) for x in one]) for one in model.values()], axis=1)
        size = np.linalg.norm(columns, axis=0)
        u, s, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        basis = u[:, s > 1e-8 * s[0]] if s.size else basis
    sizes = [one.shape for one in latent]
    found = []
    for name, parts in candidates.items():
        x = np.concatenate([np.ravel(one) for one in parts])
        own = x - basis @ (basis.T @ x)
        square = float(own @ own)
        if not square > _LEAST * float(x @ x):
            continue
        coefficient = float(own @ y) / square
        parts_of = zip(latent, _split(own, sizes), strict=True)
        variance = sum(variance_of_product(one, part) for one, part in parts_of)
        z = coefficient * square / np.sqrt(variance)
        p = float(2.0 * stats.norm.sf(abs(z)))
        found.append(Proposal(name, coefficient**2 * square / power, coefficient, float(z), p, 1.0))
    many = len(found)
    ranked = sorted(found, key=lambda one: -one.share)
    return [one._replace(p_any=min(1.0, many * one.p_value)) for one in ranked]


def _split(values: Array, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
    return [part.reshape(shape) for part, shape in zip(np.split(values, ends), shapes, strict=True)]
