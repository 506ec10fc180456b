"""What a fit tells of its flights: errors of the integration, and how standard its prediction errors are."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.likelihood.kalman import MeanCorrection
from bayeschute.posterior.marginal import projected_residuals
from bayeschute.study.assembly.fits import groups, load_fit
from bayeschute.study.job import Job
from bayeschute.study.load import load_study
from bayeschute.study.run.stage_check import _innovation_share, _InnovationShare, _step_error


@pytest.fixture(scope="module")
def stored(finished, descents):
    job = Job(load_study(descents.study), finished.folder, False, "", lambda *_: None)
    return load_fit(job, groups(job)[0])


def test_the_error_of_a_step_falls_with_its_fourth_power(stored):
    """Of a Runge-Kutta step; twice as many of them have a sixteenth of it."""
    flight, along, theta = stored.marginal.flights[0], stored.marginal.along[0], stored.optimum.theta
    told = []
    for substeps in (2, 4):
        coarse = replace(flight, model=replace(flight.model, stepping=Stepping(substeps)))
        told.append(_step_error(coarse, theta, along))
    assert told[0] < 0.1 and 10.0 < told[0] / told[1] < 24.0


def test_a_step_s_error_is_in_standard_deviations_of_prediction_errors(stored):
    """Against the first step after a datum by itself, which no later one adds to."""
    flight, along, theta = stored.marginal.flights[0], stored.marginal.along[0], stored.optimum.theta
    coarse = replace(flight, model=replace(flight.model, stepping=Stepping(1)))

    def ends(substeps):
        model, driven = replace(flight.model, stepping=Stepping(substeps)), along.at.latent_path(flight)
        numbers = model.numbers(jnp.asarray(theta))
        record, path, error = model.inputs(), np.asarray(driven.path), np.asarray(driven.error)
        rows = [type(record)(*(np.asarray(a)[t] for a in vars(record).values())) for t in (0, 1)]
        return np.asarray(model.advance(jnp.asarray(path[0]), numbers, *rows, error[0], error[1]))

    lead = ends(2) - ends(1)
    assert np.abs(np.asarray(along.linear.steps.out_state)[1] @ lead).max() > 0.0
    alone = np.asarray(along.gains.output)[1, :, : lead.size] @ lead / np.asarray(along.gains.root)[1, 0, 0]
    assert _step_error(coarse, theta, along) >= 0.999 * float(np.abs(alone).max())


def test_prediction_errors_are_standard(stored):
    """The share is that of the innovations of the density at its centre, its gap left out."""
    bare = tuple(
        along._replace(mean_correction=MeanCorrection(*(np.zeros_like(part) for part in along.mean_correction)))
        for along in stored.marginal.along
    )
    size = len(stored.optimum.theta)
    unit = np.asarray(projected_residuals(replace(stored.marginal, along=bare), np.zeros((size, 1))))[:, 0]
    for flight, along in zip(stored.marginal.flights, stored.marginal.along, strict=True):
        own, unit = np.split(unit, [np.size(flight.observed)])
        own = own[np.asarray(flight.present).ravel()]
        share = _innovation_share(flight, along)
        assert share.inside == pytest.approx(np.mean(np.abs(own) < 1.6449), abs=0.02) and 0.8 < share.inside <= 1.0
        assert share.data == own.size


@pytest.mark.parametrize("data", [30, 71, 300, 3000])
def test_prediction_errors_of_a_sound_fit_are_seldom_missed_however_few(data):
    """By the binomial law; those of a wrong one, of which 80 % are inside, nearly always once there are many."""
    inside = np.arange(data + 1)
    missed = np.array([_InnovationShare(k / data, data).excess >= 1.0 for k in inside])
    assert missed @ scipy.stats.binom.pmf(inside, data, 0.9) < 0.02
    if data >= 300:
        assert missed @ scipy.stats.binom.pmf(inside, data, 0.8) > 0.98
