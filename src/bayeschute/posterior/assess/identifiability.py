"""Practical identifiability: sloppy directions, confounding with noise parameters, power-scaling sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import arviz_stats
import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayeschute.likelihood.disturbances import KINDS
from bayeschute.likelihood.priors import Prior, factor, standard, values, working
from bayeschute.posterior.assess.identifiability_result import Direction
from bayeschute.posterior.noise_uncertainty import NoiseEffect, joint_covariance

Array = NDArray[np.float64]
_PARTS = {"drift": ("sd", "time constant"), "oscillator": ("sd", "frequency", "damping ratio")}


def directions(covariance: Array, priors: Sequence[Prior]) -> list[Direction]:
    """Combinations of the parameters from the least to the best determined: eigenvectors of the Fisher information.

    In coordinates in which the prior is standard normal, the Laplace precision is one plus the record's information.
    Weights are those of the parameters in their own prior standard deviations.

    Args:
        covariance: Laplace covariance in working coordinates (P, P): `Optimum.covariance`, or
            ``scale @ scale.T`` of a `Marginal`.
        priors: Priors of the parameters.
    """
    scale, root = working(priors)[1], factor(priors)
    information = root.T @ np.linalg.inv(covariance) @ root - np.eye(len(priors))
    found, vectors = np.linalg.eigh(0.5 * (information + information.T))
    vectors = root @ vectors / scale[:, None]
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    made = []
    for value, vector in zip(np.maximum(found, 0.0), vectors.T, strict=True):
        turned = vector * np.sign(vector[np.argmax(np.abs(vector))])
        weights = {p.name: float(w) for p, w in zip(priors, turned, strict=True)}
        made.append(Direction(weights, float(value), float(value / (1.0 + value)), in_words(weights)))
    return made


def in_words(weights: Mapping[str, float], least: float = 0.3) -> str:
    """A direction as a sum, parameters of small weight left out: ``0.81 C_Aalpha - 0.59 alpha_0``."""
    parts = sorted(weights.items(), key=lambda item: -abs(item[1]))
    kept = [(name, w) for i, (name, w) in enumerate(parts) if i == 0 or abs(w) >= least]
    text = " ".join(f"{'-' if w < 0.0 else '+'} {abs(w):.2f} {name}" for name, w in kept)
    return text.removeprefix("+ ")


class Confounding(NamedTuple):
    """Confounding of the parameters with the noise parameters.

    Attributes:
        parameters: Names (P).
        noise_parameters: Names of the noise parameters (V).
        correlation: Between parameters and logarithms of noise parameters in their joint posterior (P, V).
        share: Reduction of every parameter's variance if the noise parameters were known to be what they
            are at the mode, as a share (P,).
    """

    parameters: tuple[str, ...]
    noise_parameters: tuple[str, ...]
    correlation: Array
    share: Array

    def strongest(self) -> dict[str, tuple[str, float]]:
        """Every parameter's strongest partner among the noise parameters, with the correlation."""
        picked = np.argmax(np.abs(self.correlation), axis=1)
        return {
            name: (self.noise_parameters[j], float(self.correlation[i, j]))
            for i, (name, j) in enumerate(zip(self.parameters, picked, strict=True))
        }


def confounding(
    scale: Array,
    effect: NoiseEffect,
    noise_parameter_covariance: Array,
    priors: Sequence[Prior],
    noise_parameters: Sequence[str],
) -> Confounding:
    """Correlations of parameters with noise parameters in the joint posterior, and their contribution to the variance.

    Args:
        scale: Factor of the parameters' covariance for fixed noise parameters, as in `Marginal` (P, P).
        effect: Of the noise parameters.
        noise_parameter_covariance: Of their logarithms (V, V).
        priors: Priors of the parameters.
        noise_parameters: Names of the noise parameters, see `noise_parameter_labels`.
    """
    held, whole = np.diag(scale @ scale.T), np.diag(joint_covariance(scale, effect, noise_parameter_covariance))
    together = scale @ effect.slope @ noise_parameter_covariance
    sd = np.sqrt(np.outer(whole, np.diag(noise_parameter_covariance)))
    return Confounding(tuple(p.name for p in priors), tuple(noise_parameters), together / sd, 1.0 - held / whole)


def noise_parameter_labels(channels: Sequence[str], groups: Sequence[str], kinds: Sequence[str]) -> list[str]:
    """Names of all noise parameters, in the order of `score.to_vector`.

    Args:
        channels: Channels of the residual noise.
        groups: Groups of latent processes.
        kinds: Kind of every group, of `latent.KINDS`.
    """
    assert all(len(_PARTS[kind]) == count for kind, count in KINDS.items())
    parts = ("white noise", "correlated noise", "time constant")
    noise = [f"{channel}, {part}" for part in parts for channel in channels]
    return noise + [f"{group}, {part}" for group, kind in zip(groups, kinds, strict=True) for part in _PARTS[kind]]


class Sensitivity(NamedTuple):
    """How strongly a posterior answers to its parts made a little stronger or weaker (power scaling).

    Attributes:
        prior: To the prior.
        likelihood: To the likelihood.
    """

    prior: float
    likelihood: float


def power_scaling(priors: Sequence[Prior], theta: Array, likelihood: Array) -> Mapping[str, Sensitivity]:
    """Power-scaling sensitivity of every parameter (Kallioinen et al. 2024) by ArviZ.

    Args:
        priors: Priors of the parameters.
        theta: Draws in working coordinates (chain, draw, P), of the sampler itself.
        likelihood: Their log likelihood (chain, draw), up to a constant.
    """
    names, own = [p.name for p in priors], values(priors, theta)
    tree = from_dict(
        {
            "posterior": {name: own[..., i] for i, name in enumerate(names)},
            "log_prior": {"all": -0.5 * np.sum(standard(priors, theta) ** 2, axis=-1)},
            "log_likelihood": {"all": likelihood},
        }
    )
    found: list[xr.Dataset] = [arviz_stats.psense(tree, group=group) for group in ("prior", "likelihood")]
    return {name: Sensitivity(*(float(part[name]) for part in found)) for name in names}
