"""Identifiability analysis of each fit, in numbers: a part of the stage `check`.

Directions of least information and confounding cost little compared with a fit. Profiles cost simulations, so they are
computed only of parameters that are sensitive to the prior: for the others the posterior gives the same interval.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.likelihood.priors import working
from bayeschute.posterior.assess import identifiability
from bayeschute.posterior.assess.identifiability import FELT, Confounding, Sensitivity
from bayeschute.posterior.assess.profile import likelihood_interval, profile
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.study import formulation
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Group, Stored
from bayeschute.study.job import Job

Array = NDArray[np.float64]
LEVEL = 0.9  # of likelihood intervals
ROUNDS = 2  # of a profile's optimisation: the third changes a log likelihood by less than 0.001 in the default study
_PARTS = {"white": "white noise", "correlated": "correlated noise", "time_constant": "time constant"}


def of_fit(job: Job, group: Group, stored: Stored) -> dict[str, Any]:
    """Identifiability of the parameters of one fit.

    Args:
        job: The run.
        group: The fit.
        stored: It, as read back.

    Returns:
        ``parameters``: by name ``shift`` (of the posterior's mean from the prior's, in standard deviations of the
        prior) and, where they are known, ``noise_share``, ``noise_partner``, ``noise_correlation``,
        ``prior_sensitivity``, ``likelihood_sensitivity``, ``diagnosis`` and ``likelihood_interval``; ``directions``,
        the least determined first; ``confounding``: all correlations of parameters with noise parameters;
        ``noise``: contraction of every noise parameter's logarithm. Draws of the sandwich come from no prior, no
        likelihood and no noise parameters: of those, only shifts and directions are given.
    """
    sandwich = job.study.noise.model == "sandwich"
    centre, scale = working(group.priors)
    flat = stored.held.reshape(-1, centre.size)
    shift = (flat.mean(axis=0) - centre) / scale
    by_parameter: dict[str, dict[str, Any]] = {
        p.name: {"shift": float(s)} for p, s in zip(group.priors, shift, strict=True)
    }  # fmt: skip
    made: dict[str, Any] = {"parameters": by_parameter, "noise": {}}
    covariance = np.cov(flat, rowvar=False).reshape(scale.size, -1) if sandwich else stored.optimum.covariance
    found = identifiability.directions(covariance, group.priors)
    made["directions"] = [d._asdict() | {"words": identifiability.in_words(d)} for d in found]
    if not sandwich:
        _with_noise(job, group, stored, made)
        _with_prior(job, group, stored, by_parameter)
    return dict(assemble.as_plain(made))


def noise_labels(job: Job) -> tuple[list[str], NDArray[np.bool_]]:
    """Names of all noise parameters in the order of `score.to_vector`, and which of them the noise model uses."""
    study = job.study
    canopies = 1 if study.vehicle is None else study.vehicle.canopies.number
    labels = identifiability.noise_parameter_labels(
        list(study.noise.channels()), assemble.noise_parameter_names(study), assemble.latent(study, canopies).kinds
    )
    idle = tuple(_PARTS[part] for part in formulation.unused(study.noise.model))
    return labels, np.array([not (idle and label.endswith(idle)) for label in labels])


def _with_noise(job: Job, group: Group, stored: Stored, made: dict[str, Any]) -> None:
    """Confounding with the noise parameters, and the contraction of these."""
    labels, used = noise_labels(job)
    names = [label for label, u in zip(labels, used, strict=True) if u]
    spread = stored.noise_parameter_covariance[np.ix_(used, used)]
    slope, by_law, excess = stored.noise_effect
    effect = NoiseEffect(slope[:, used], by_law[used], excess)
    mixed: Confounding = identifiability.confounding(
        np.asarray(stored.marginal.scale), effect, spread, group.priors, names
    )
    partners = mixed.strongest()
    for name, share in zip(mixed.parameters, mixed.share, strict=True):
        partner, correlation = partners[name]
        facts = {"noise_share": share, "noise_partner": partner, "noise_correlation": correlation}
        made["parameters"][name] |= facts
    before = NoisePrior(assemble.hyper(job.study)).log_sd
    made["noise"] = dict(zip(names, 1.0 - np.diag(spread) / before**2, strict=True))
    made["confounding"] = {"noise": names, "correlation": dict(zip(mixed.parameters, mixed.correlation, strict=True))}


def _with_prior(job: Job, group: Group, stored: Stored, by_parameter: dict[str, dict[str, Any]]) -> None:
    """Power-scaling sensitivity of every parameter; a profile-likelihood interval where the prior matters."""
    scaled = identifiability.power_scaling(group.priors, stored.held, log_likelihood(job, group))
    for i, p in enumerate(group.priors):
        felt: Sensitivity = scaled[p.name]
        facts = {"prior_sensitivity": felt.prior, "likelihood_sensitivity": felt.likelihood}
        by_parameter[p.name] |= facts | {"diagnosis": felt.diagnosis() if np.isfinite(felt).all() else None}
        if felt.prior >= FELT:
            ends = likelihood_interval(profile(stored.marginal, group.priors, i, rounds=ROUNDS), LEVEL)
            by_parameter[p.name]["likelihood_interval"] = {
                "level": LEVEL,
                "low": ends.low,
                "high": ends.high,
                "unit": p.unit,
            }


def log_likelihood(job: Job, group: Group) -> Array:
    """Log likelihood of the flights of a fit for the sampler's own draws (chain, draw), up to a constant."""
    with xr.open_datatree(job.out / "posterior.nc", engine="h5netcdf") as tree:
        rows = [np.asarray(tree["log_likelihood"][flight.name].values) for flight in group.flights]
    return np.asarray(sum(row.sum(axis=-1) for row in rows))
