"""Identifiability analysis of each fit, in numbers: a part of the stage `check`.

Directions of least information and confounding cost little compared with a fit. Profiles cost simulations, so they are
computed only of parameters that are sensitive to the prior: for the others the posterior gives the same interval.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.numerics import processors
from bayeschute.likelihood.priors import working
from bayeschute.posterior.assess import identifiability
from bayeschute.posterior.assess.identifiability import Confounding
from bayeschute.posterior.assess.identifiability_result import (
    SENSITIVE,
    FitIdentifiability,
    LikelihoodInterval,
    NoiseCorrelations,
    ParameterIdentifiability,
    diagnosis,
)
from bayeschute.posterior.assess.profile import likelihood_interval, profile
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.study import formulation
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Group, Stored, posterior_groups
from bayeschute.study.job import Job

Array = NDArray[np.float64]
LEVEL = 0.9  # of likelihood intervals
ROUNDS = 2  # of a profile's optimisation: the third changes a log likelihood by less than 0.001 in the default study
_PARTS = {"white": "white noise", "correlated": "correlated noise", "time_constant": "time constant"}


def of_fit(job: Job, group: Group, stored: Stored) -> FitIdentifiability:
    """Identifiability of the parameters of one fit.

    Draws of the sandwich come from no prior, no likelihood and no noise parameters: of those, only contractions, shifts
    and directions are given.

    Args:
        job: The run.
        group: The fit.
        stored: It, as read back.
    """
    sandwich = job.study.noise.model == "sandwich"
    centre, scale = working(group.priors)
    flat = stored.held.reshape(-1, centre.size)
    shift = (flat.mean(axis=0) - centre) / scale
    covariance = np.cov(flat, rowvar=False).reshape(scale.size, -1) if sandwich else stored.optimum.covariance
    removed = _contractions(job)
    found = FitIdentifiability(
        {
            p.name: ParameterIdentifiability(removed.get(p.name), float(s))
            for p, s in zip(group.priors, shift, strict=True)
        },
        tuple(identifiability.directions(covariance, group.priors)),
    )
    return found if sandwich else _with_prior(job, group, stored, _with_noise(job, group, stored, found))


def _contractions(job: Job) -> dict[str, float]:
    """Share of the prior's variance that the data remove [1], by parameter."""
    before, after = posterior_groups(job, "prior", "posterior")
    return {str(name): 1.0 - float(after[name].std() / before[name].std()) ** 2 for name in before if name in after}


def noise_labels(job: Job) -> tuple[list[str], NDArray[np.bool_]]:
    """Names of all noise parameters in the order of `score.to_vector`, and which of them the noise model uses."""
    study = job.study
    canopies = 1 if study.vehicle is None else study.vehicle.canopies.number
    labels = identifiability.noise_parameter_labels(
        list(study.noise.channels()), assemble.noise_parameter_names(study), assemble.latent(study, canopies).kinds
    )
    idle = tuple(_PARTS[part] for part in formulation.unused(study.noise.model))
    return labels, np.array([not (idle and label.endswith(idle)) for label in labels])


def _with_noise(job: Job, group: Group, stored: Stored, found: FitIdentifiability) -> FitIdentifiability:
    """With the confounding with the noise parameters, and the contraction of these."""
    labels, used = noise_labels(job)
    names = tuple(label for label, u in zip(labels, used, strict=True) if u)
    spread = stored.noise_parameter_covariance[np.ix_(used, used)]
    slope, by_noise_parameter, excess, misfit = stored.noise_effect
    effect = NoiseEffect(slope[:, used], by_noise_parameter[used], excess if misfit is None else excess - misfit)
    mixed: Confounding = identifiability.confounding(
        np.asarray(stored.marginal.scale), effect, spread, group.priors, names
    )
    partners, parameters = mixed.strongest(), dict(found.parameters)
    for name, share in zip(mixed.parameters, mixed.share, strict=True):
        partner, correlation = partners[name]
        parameters[name] = replace(
            parameters[name], noise_share=float(share), noise_partner=partner, noise_correlation=correlation
        )
    before = assemble.noise_prior(job.study).log_sd
    contraction = (1.0 - np.diag(spread) / before**2).tolist()
    rows = map(tuple, mixed.correlation.tolist())
    correlations = NoiseCorrelations(names, dict(zip(mixed.parameters, rows, strict=True)))
    noise = dict(zip(names, contraction, strict=True))
    return replace(found, parameters=parameters, noise=noise, confounding=correlations)


def _with_prior(job: Job, group: Group, stored: Stored, found: FitIdentifiability) -> FitIdentifiability:
    """With the power-scaling sensitivity of every parameter; a profile-likelihood interval where the prior matters."""
    scaled = identifiability.power_scaling(group.priors, stored.held, log_likelihood(job, group))
    felt = [i for i, p in enumerate(group.priors) if scaled[p.name].prior >= SENSITIVE]

    def interval(i: int) -> LikelihoodInterval:
        ends = likelihood_interval(profile(stored.marginal, group.priors, i, rounds=ROUNDS), LEVEL)
        return LikelihoodInterval(LEVEL, group.priors[i].unit, ends.low, ends.high)

    with ThreadPoolExecutor(processors()) as pool:
        intervals = dict(zip(felt, pool.map(interval, felt), strict=True))
    parameters = dict(found.parameters)
    for i, p in enumerate(group.priors):
        prior, likelihood = (float(one) if np.isfinite(one) else None for one in scaled[p.name])
        facts = replace(
            parameters[p.name],
            prior_sensitivity=prior,
            likelihood_sensitivity=likelihood,
            likelihood_interval=intervals.get(i),
        )
        parameters[p.name] = replace(facts, diagnosis=diagnosis(facts))
    return replace(found, parameters=parameters)


def log_likelihood(job: Job, group: Group) -> Array:
    """Log likelihood of the flights of a fit for the sampler's own draws (chain, draw), up to a constant."""
    (by_flight,) = posterior_groups(job, "log_likelihood")
    rows = [by_flight[flight.name].values for flight in group.flights]
    return np.asarray(sum(row.sum(axis=-1) for row in rows))
