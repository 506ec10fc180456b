"""What an identifiability analysis of a fit found, as it is stored and reported; free of JAX."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class LikelihoodInterval:
    """Interval of a profile likelihood.

    Attributes:
        level: Probability that it is named after [1].
        unit: Of the ends.
        low: Lower end; None where the likelihood does not bound the parameter to this side.
        high: Upper end; likewise.
    """

    level: float
    unit: str = "1"
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class ParameterIdentifiability:
    """What the data say of one parameter beyond its prior; None: not known.

    Attributes:
        shift: Of the posterior mean from the prior mean [standard deviations of the prior].
        noise_share: Share of the posterior variance that is due to uncertain noise parameters [1].
        noise_partner: The noise parameter that it correlates with most.
        noise_correlation: That correlation [1].
        prior_sensitivity: Power-scaling sensitivity to the prior.
        likelihood_sensitivity: To the likelihood.
        diagnosis: Of both, in words.
        likelihood_interval: Of its profile likelihood, where the prior matters.
    """

    shift: float | None = None
    noise_share: float | None = None
    noise_partner: str | None = None
    noise_correlation: float | None = None
    prior_sensitivity: float | None = None
    likelihood_sensitivity: float | None = None
    diagnosis: str | None = None
    likelihood_interval: LikelihoodInterval | None = None


@dataclass(frozen=True)
class Direction:
    """A combination of the parameters, each measured in standard deviations of its prior.

    Attributes:
        weights: Of every parameter; their squares sum to one.
        information: Information of the data along it relative to that of the prior (an eigenvalue).
        contraction: Share of the prior's variance along it that the record takes away.
        words: It as a sum, parameters of small weight left out.
    """

    weights: Mapping[str, float]
    information: float | None
    contraction: float | None
    words: str


@dataclass(frozen=True)
class NoiseCorrelations:
    """All correlations of parameters with noise parameters.

    Attributes:
        noise: Names of the noise parameters (V).
        correlation: By parameter (V,).
    """

    noise: tuple[str, ...]
    correlation: Mapping[str, tuple[float | None, ...]]


@dataclass(frozen=True)
class FitIdentifiability:
    """Identifiability of the parameters of one fit.

    Attributes:
        parameters: By name.
        directions: Combinations of the parameters, the least determined first.
        noise: Contraction of the logarithm of every noise parameter.
        confounding: Of parameters with noise parameters; None of a sandwich.
    """

    parameters: Mapping[str, ParameterIdentifiability]
    directions: tuple[Direction, ...] = ()
    noise: Mapping[str, float | None] = field(default_factory=dict)
    confounding: NoiseCorrelations | None = None
