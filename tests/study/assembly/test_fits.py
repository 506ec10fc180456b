"""Fits as they are kept and taken up: what a finished run tells, posterior draws as priors, populations' priors."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from bayeschute.likelihood.joint import Lifted, Unknowns
from bayeschute.likelihood.priors import Prior, correlated, covariance, working
from bayeschute.posterior.marginal import Quadratic, log_density
from bayeschute.posterior.mode_checks import profile
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.study.assembly import fits
from bayeschute.study.assembly.fits import gaussian_summary, groups, load_fit, structure_of
from bayeschute.study.job import Job
from bayeschute.study.load import load_study

LAW = np.array([[0.04, 0.01], [0.01, 0.09]])
PRIORS = correlated(
    [Prior("axial[1]", 0.0, 1.0, False, "1", "x"), Prior("transverse[e]", 0.0, 1.0, False, "1", "x")],
    np.array([0.9, 0.1]),
    LAW,
)


def test_derivatives_by_all_parameters_are_taken_up_as_those_by_a_flights_own():
    along = SimpleNamespace(parameters=np.array([0, 2]), theta=np.zeros(3))
    whole = Lifted(Unknowns(np.arange(6.0).reshape(2, 3), np.ones((4, 1, 3))), np.ones((4, 1, 3)), np.ones((4, 2, 3)))
    own = fits._of_own(whole, along)
    np.testing.assert_array_equal(own.unknowns.start, [[0.0, 2.0], [3.0, 5.0]])
    assert own.path.shape == (4, 2, 2)
    jax.tree.map(np.testing.assert_array_equal, fits._of_own(own, along), own)  # as fits store them now
    alone = SimpleNamespace(parameters=np.arange(3), theta=np.zeros(3))
    jax.tree.map(np.testing.assert_array_equal, fits._of_own(whole, alone), whole)


def test_a_fit_that_is_taken_up_says_whether_it_ended_at_a_mode(finished, descents):
    job = Job(load_study(descents.study), finished.folder, False, "", lambda *_: None)
    for group in groups(job):
        stored = load_fit(job, group)
        again = profile(stored.marginal)
        assert stored.is_mode and again.is_mode
        # What is kept is of the density about its mode, which the centre is next to.
        assert stored.least_fall == pytest.approx(again.worst, abs=0.03) == pytest.approx(0.5, abs=0.2)


def test_a_fit_that_is_taken_up_has_the_density_that_was_kept(finished, descents, tmp_path):
    """With corrections of every kind, slopes and curvatures; and its draws follow the parameters as before."""
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    job = Job(load_study(descents.study), folder, False, "", lambda *_: None)
    group = groups(job)[0]
    stored = load_fit(job, group)
    bent = (Quadratic(np.array([s]), np.array([[c]])) for s, c in ((0.3, 0.05), (-0.2, 0.1)))
    along = tuple(one._replace(aside=jax.tree.map(lambda a: a + 0.1, one.aside)) for one in stored.marginal.along)
    kept = replace(stored.marginal, along=along, **dict(zip(("determinant", "bend"), bent, strict=True)))
    found = SimpleNamespace(**vars(stored) | {"marginal": kept, "evidence": 1.0, "profile": profile(kept)})
    xi = (stored.held - stored.optimum.theta) @ np.linalg.inv(np.asarray(kept.scale)).T
    fits.save_fit(job, group, found, Draws(xi, xi[..., 0], {}, 3, 4, ()), xi)
    again = load_fit(job, group)
    points = np.linspace(-2.0, 2.0, 5)[None]
    np.testing.assert_allclose(log_density(again.marginal, points), log_density(kept, points), atol=1e-4)
    np.testing.assert_allclose(again.held, stored.held, atol=1e-12)
    for ours, theirs in zip(again.marginal.along, kept.along, strict=True):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), ours.aside, theirs.aside)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), ours.at, theirs.at)
    assert (again.failed, again.evaluations, again.least_fall) == (3, 4, found.profile.worst)


def test_posterior_draws_are_summed_up_with_their_covariance():
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal([0.8, 0.2], [[0.01, -0.008], [-0.008, 0.02]], size=(4, 500))
    made = gaussian_summary(PRIORS, draws)
    flat = draws.reshape(-1, 2)
    np.testing.assert_allclose(working(made)[0], flat.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(covariance(made), np.cov(flat, rowvar=False), rtol=1e-9)
    assert [(p.name, p.source, p.unit) for p in made] == [(p.name, "posterior", "1") for p in PRIORS]
    (alone,) = gaussian_summary(PRIORS[:1], draws[..., :1])
    assert alone.scale == pytest.approx(flat[:, 0].std(), rel=1e-3) and alone.correlation == {}


def _job(vary=None, vary_canopies=None):
    flights = tuple(SimpleNamespace(name=name) for name in ("one", "two"))
    priors = SimpleNamespace(vary=vary, vary_canopies=vary_canopies, hierarchical=bool(vary or vary_canopies))
    vehicle = SimpleNamespace(canopies=SimpleNamespace(number=2))
    study = SimpleNamespace(model="cluster", vehicle=vehicle, priors=priors, with_role=lambda role: flights)
    return SimpleNamespace(study=study)


@pytest.mark.parametrize(
    ("vary", "canopies", "names"),
    [
        (None, None, ["all"]),
        (("axial[1]",), None, ["one", "two"]),
        (None, ("axial[1]",), ["all"]),
    ],
)
def test_members_of_a_population_are_independent_of_the_rest(monkeypatch, vary, canopies, names):
    """Priors are correlated by name where every parameter is one, and not where one stands for several."""
    monkeypatch.setattr(fits, "load_priors", lambda job: PRIORS)
    made = groups(_job(vary, canopies))
    assert [group.name for group in made] == names
    for group in made:
        found = covariance(group.priors)
        if vary is None and canopies is None:
            np.testing.assert_allclose(found, LAW)
        else:
            np.testing.assert_array_equal(found, np.diag(np.diag(found)))
            assert all(p.correlation == {} for p in group.priors)
    assert len(made[0].priors) == (5 if canopies else 2)


def test_the_structure_is_held_at_the_least_angle_of_its_coefficients():
    def one(name, saturation=None):
        return Prior(name, 0.0, 1.0, False, "1", "x", saturation=saturation)

    assert structure_of([one("axial[1]"), one("riser_length")], 2).saturation is None
    made = structure_of([one("axial[1]", 0.5), one("transverse[e]", 0.4), one("riser_length")], 2)
    assert (made.axial, made.transverse, made.saturation) == (("1",), ("e",), 0.4)
