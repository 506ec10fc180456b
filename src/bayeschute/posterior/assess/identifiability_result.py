"""What an identifiability analysis of a fit found, as it is stored and reported; free of JAX."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

SENSITIVE = 0.05
"""Power-scaling sensitivity from which a component matters (Kallioinen et al. 2024)."""
INFORMED = 0.5
"""Contraction from which a parameter counts as determined by the data."""
UNINFORMED = 0.1
"""Contraction below which the posterior counts as the prior."""
CONFLICT = 1.0
"""Shift of the mean in prior standard deviations that, with both sensitivities, may be a conflict."""
INSENSITIVE, PRIOR_ONLY, UNTOLD = "insensitive to the prior", "determined by the prior", "the posterior is the prior"
FELT = "determined by the data, and the prior is felt"
AGREE, MAY_CONFLICT = "prior and data both matter, and agree", "possible conflict of prior and data"


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
        contraction: Share of the prior's variance that the data remove [1]; negative where the posterior is wider.
        shift: Of the posterior mean from the prior mean [standard deviations of the prior].
        noise_share: Share of the posterior variance that is due to uncertain noise parameters [1].
        noise_partner: The noise parameter that it correlates with most.
        noise_correlation: That correlation [1].
        prior_sensitivity: Power-scaling sensitivity to the prior.
        likelihood_sensitivity: To the likelihood.
        diagnosis: What determines it, in words.
        likelihood_interval: Of its profile likelihood, where the prior matters.
    """

    contraction: float | None = None
    shift: float | None = None
    noise_share: float | None = None
    noise_partner: str | None = None
    noise_correlation: float | None = None
    prior_sensitivity: float | None = None
    likelihood_sensitivity: float | None = None
    diagnosis: str | None = None
    likelihood_interval: LikelihoodInterval | None = None


def diagnosis(facts: ParameterIdentifiability) -> str | None:
    """What determines a parameter, in words; None where its sensitivities are not known.

    Without a contraction to speak of, sensitivities are those of a prior.

    Example:
        >>> felt = ParameterIdentifiability(0.4, 0.3, prior_sensitivity=0.2, likelihood_sensitivity=0.1)
        >>> diagnosis(felt), diagnosis(ParameterIdentifiability(-0.2, 0.3, prior_sensitivity=0.2))
        ('prior and data both matter, and agree', 'the posterior is the prior')
    """
    if facts.prior_sensitivity is None:
        return None
    moved = facts.shift is not None and abs(facts.shift) >= CONFLICT
    if facts.contraction is not None and facts.contraction < UNINFORMED and not moved:
        return UNTOLD
    if facts.prior_sensitivity < SENSITIVE:
        return INSENSITIVE
    if facts.likelihood_sensitivity is None or facts.likelihood_sensitivity < SENSITIVE:
        return FELT if facts.contraction is not None and facts.contraction >= INFORMED else PRIOR_ONLY
    return MAY_CONFLICT if moved else AGREE


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
