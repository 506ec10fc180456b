"""Noise models of a study (``[noise] model``): latent disturbances, AR(1) residuals, white noise, sandwich."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayeschute.likelihood.noise import Noise
from bayeschute.study.schema.belief_schema import ChannelNoise, NoiseTable
from bayeschute.study.study import Study

_TINY = 1e-6  # stands for no noise of a kind: a logarithm is needed
_UNUSED = {"ar1": ("white",), "white": ("correlated", "time_constant"), "sandwich": ("correlated", "time_constant")}
_LABELS = {
    "white": "for teaching only, not for use: white measurement noise; intervals are several times too narrow",
    "sandwich": "for comparison: classical output error with colored standard errors; intervals are too narrow",
    "ar1": "for comparison: no latent disturbances, AR(1) residuals; intervals are too narrow",
    "ar1+white": "for comparison: no latent disturbances, AR(1) + white residuals; intervals are too narrow",
}


def noise_medians(channels: Sequence[ChannelNoise[float]], model: str) -> Noise:
    """Medians of the residual noise per channel.

    Where a noise model has one part only, that part has the variance of both.

    Args:
        channels: Tables of the channels.
        model: ``[noise] model``.
    """
    white, correlated = (np.array([getattr(t, key) or 0.0 for t in channels]) for key in ("white", "correlated"))
    time_constant = np.array([t.time_constant or 1.0 for t in channels])
    if model == "ar1":
        white, correlated = 0.0 * white, np.hypot(white, correlated)
    if model in ("white", "sandwich"):
        white, correlated = np.hypot(white, correlated), 0.0 * correlated
        time_constant = np.ones(len(channels))
    return Noise(np.where(white > 0.0, white, _TINY), np.where(correlated > 0.0, correlated, _TINY), time_constant)


def unused(model: str) -> tuple[str, ...]:
    """Noise parameters of a channel that a noise model does not have."""
    return _UNUSED.get(model, ())


def unused_of(channel: ChannelNoise[float], model: str) -> tuple[str, ...]:
    """Those of one channel, which may have a white or a correlated part alone."""
    stated = {name: getattr(channel, name) for name in ("white", "correlated", "time_constant")}
    return unused(model) or tuple(name for name, value in stated.items() if value is None)


def label(model: str) -> str:
    """Beginning of the label of a result; empty for the default."""
    return _LABELS.get(model, "")


def sampler(study: Study) -> str:
    """The sampler, or ``sandwich`` for normal draws about the estimates of output error."""
    return "sandwich" if study.noise.model == "sandwich" else str(study.sampler.kind)


def notes(table: NoiseTable) -> list[str]:
    """Notes on a noise model that is not the default."""
    if table.model == "latent":
        return []
    said = [f"Noise model {table.model!r}: there are no latent disturbances, so predictions contain no wind error."]
    if table.has_latent():
        said.append("Tables of latent disturbances in the study's [noise] are not used by this noise model.")
    said.append("Terms that equation error did not select are not tested: the test needs latent disturbances.")
    if table.model == "sandwich":
        said.append(
            "Draws are normal about the optimum for white residuals, with the sandwich covariance for colored "
            "residuals (autocovariance up to a tenth of the record, Parzen window); no sampler was run."
        )
    return said
