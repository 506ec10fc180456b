"""The marginal posterior is found from data and priors: its mode, its noise parameters, its determinant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from bayeschute.likelihood.kalman_gradient import to_vector
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.beyond_linear import linear_errors, polynomials
from bayeschute.posterior.fit import joint_fit, laplace_fit, marginal_mode
from bayeschute.posterior.marginal import Quadratic, log_density
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.score_dispersion import Dispersion


def test_found(found, descent):
    assert found.optimum.converged
    assert abs(found.optimum.theta[0] - descent.theta[0]) < 4.0 * np.sqrt(found.optimum.covariance[0, 0])
    assert found.noise_parameter_covariance.shape == (5, 5) and np.isfinite(found.evidence)
    assert np.linalg.eigvalsh(found.noise_parameter_covariance).min() > 0.0
    slope, spread, excess, _ = found.noise_effect
    assert slope.shape == (1, 5) and 0.01 < np.abs(slope).max() < 2.0
    assert spread.shape == (5, 1, 1) and 0.1 < np.abs(spread).max() < 2.5
    assert excess.shape == (1, 1) and abs(excess[0, 0]) < 0.2
    assert 0.0 < found.determinant_error < 0.05


def test_the_optimum_is_the_mode_of_the_marginal_posterior(found):
    """With the determinant the density is level there; without it, it is not."""

    def slope(marginal):
        ends = np.asarray(log_density(marginal, np.array([[-0.1, 0.1]])))
        return (ends[1] - ends[0]) / 0.2

    again, _ = polynomials.corrected(found.marginal)
    for name in ("determinant", "bend"):
        for stored, anew in zip(getattr(found.marginal, name), getattr(again, name), strict=True):
            np.testing.assert_allclose(
                stored, anew, rtol=1e-5, atol=1e-7
            )  # flights are sought from a little nearer now
    assert abs(slope(found.marginal)) < 0.01
    assert abs(slope(replace(found.marginal, determinant=Quadratic.none(1)))) > 0.03


def test_progress_grows(descent):
    heard = []
    prior = NoisePrior(descent.hyper, 0.4)
    laplace_fit.find(
        descent.flights, descent.priors, prior, rounds=1, progress=lambda share, words: heard.append(share)
    )
    assert heard == sorted(heard) and 0.0 <= heard[0] and heard[-1] <= 1.0


def test_the_mode_is_found_far_from_the_joint_optimum(descent, settled, monkeypatch):
    """A log determinant whose slope dies away: one slope goes much too far, the mode is where slope and cost balance."""
    factor = np.linalg.cholesky(settled.optimum.covariance)
    start = settled.optimum.theta

    def bent(made):
        """Slope of 6 per standard deviation at the joint optimum, of half that at two standard deviations."""
        away = np.linalg.solve(factor, np.asarray(made.centre) - start)
        return linear_errors.LinearErrors(6.0 * np.exp(away * np.log(2.0) / 2.0), np.zeros((1, 1)))

    monkeypatch.setattr(linear_errors, "linear_errors", bent)
    best = marginal_mode.marginal_mode(descent.flights, descent.priors, settled)
    away = float(np.linalg.solve(factor, best.theta - start)[0])
    balance = brentq(lambda x: x + 6.0 * np.exp(x * np.log(2.0) / 2.0), -6.0, 0.0)
    assert best.converged and abs(away - balance) < 0.2 < abs(-6.0 - balance)


@pytest.mark.parametrize(("share", "mode"), [(0.3, -2.5), (0.25, 2.5)])
def test_the_mode_is_found_across_a_slope_much_flatter_than_gauss_newton_expects(
    descent, settled, monkeypatch, share, mode
):
    """Cost and log determinant together rise with a share of the cost's curvature: Gauss-Newton steps stop short."""
    factor, start = np.linalg.cholesky(settled.optimum.covariance), settled.optimum.theta

    def flat(made):
        away = np.linalg.solve(factor, np.asarray(made.centre) - start)
        return linear_errors.LinearErrors(share * (away - mode) - away, np.zeros((1, 1)))

    monkeypatch.setattr(linear_errors, "linear_errors", flat)
    best = marginal_mode.marginal_mode(descent.flights, descent.priors, settled)
    away = float(np.linalg.solve(factor, best.theta - start)[0])
    assert best.converged and abs(away - mode) < 0.2


def test_between_two_looks_at_what_linear_models_lack_its_slope_follows_its_information(descent, settled, monkeypatch):
    """A correction eight times as curved as the cost: held, its slope made secants too flat, and steps bounced about."""
    factor, start = np.linalg.cholesky(settled.optimum.covariance), settled.optimum.theta
    looked, said = [], []

    def curved(made):
        away = np.linalg.solve(factor, np.asarray(made.centre) - start)
        looked.append(away)
        return linear_errors.LinearErrors(8.0 * away + 1.2, np.array([[8.0]]))

    monkeypatch.setattr(linear_errors, "linear_errors", curved)
    best = marginal_mode.marginal_mode(
        descent.flights, descent.priors, settled, lambda share, words: said.append(words), near=0.01
    )
    away = float(np.linalg.solve(factor, best.theta - start)[0])
    assert best.converged and away == pytest.approx(-1.2 / 9.0, abs=0.01)
    assert len(looked) == 1 and len(said) <= 4


def test_the_slope_over_a_short_step_says_nothing_of_the_curvature(descent, settled, monkeypatch):
    """Conditional optima are known within a tolerance: over a step of a few tenths the rest of their slopes is noise."""
    planned, used = iter((1.0, -0.3, 0.9, 0.3, 0.1)), []

    def scripted(slope, covariance, bends):
        used.append([float(np.linalg.norm(np.linalg.solve(np.linalg.cholesky(covariance), step))) for step, _ in bends])
        return next(planned) * np.linalg.cholesky(covariance)[0]

    monkeypatch.setattr(marginal_mode, "secant_step", scripted)
    best = marginal_mode.marginal_mode(descent.flights, descent.priors, settled)
    assert best.converged and [len(lengths) for lengths in used] == [0, 1, 1, 2, 2]
    np.testing.assert_allclose(used[-1], [1.0, 0.9], rtol=0.1)


@pytest.mark.parametrize(("short", "looks"), [(-np.inf, 3), (1.5, 3), (3.0, 1)])
def test_a_search_that_cannot_become_of_use_ends(descent, settled, monkeypatch, short, looks):
    """Begun 6 standard deviations off, its first step promises a rise of 18; where thrice that is wanted it is given up."""
    monkeypatch.setattr(
        linear_errors, "linear_errors", lambda made: linear_errors.LinearErrors(np.zeros(1), np.zeros((1, 1)))
    )
    off = replace(
        settled.optimum, theta=settled.optimum.theta + 6.0 * np.sqrt(settled.optimum.covariance[0]), converged=True
    )
    begin = conditional_mode.conditional_optimum(descent.flights, settled.hyper, descent.priors, off.theta, off.flights)
    said = []
    best = marginal_mode.marginal_mode(
        descent.flights, descent.priors, settled._replace(optimum=off), lambda share, words: said.append(words),
        least=18.0 * short - begin.marginal,
    )  # fmt: skip
    assert best.converged == (looks > 1) and (len(said) == 1) == (looks == 1)


def test_a_step_that_leads_to_where_flights_fail_is_halved(descent, settled, monkeypatch):
    """Flights on both sides fail farther than two standard deviations from the joint optimum; the mode is within."""
    factor, start = np.linalg.cholesky(settled.optimum.covariance), settled.optimum.theta
    failures = []

    def steep(made):
        away = np.linalg.solve(factor, np.asarray(made.centre) - start)
        if np.abs(away) > 2.0:
            failures.append(float(away[0]))
            raise FloatingPointError("flights to both sides fail")
        return linear_errors.LinearErrors(4.0 * np.exp(away), np.zeros((1, 1)))

    monkeypatch.setattr(linear_errors, "linear_errors", steep)
    best = marginal_mode.marginal_mode(descent.flights, descent.priors, settled)
    away = float(np.linalg.solve(factor, best.theta - start)[0])
    assert failures and best.converged and abs(away - brentq(lambda x: x + 4.0 * np.exp(x), -4.0, 0.0)) < 0.2
    monkeypatch.setattr(
        linear_errors, "linear_errors", lambda made: steep(SimpleNamespace(centre=start + 3.0 * factor[0]))
    )
    with pytest.raises(FloatingPointError, match="both sides"):
        marginal_mode.marginal_mode(descent.flights, descent.priors, settled)


@pytest.mark.parametrize("spoiled", [1, 3])
def test_a_turn_of_noise_parameters_that_leads_astray_is_shortened_and_at_last_not_kept(descent, monkeypatch, spoiled):
    """The first turn ends at its mode; so many tries of the second end far beside theirs."""
    sds, steps = {3: (4.0, 24), 1: (12.0, 2)}[spoiled]  # two steps leave something to gain
    prior = NoisePrior(descent.hyper, 0.4)
    settled = joint_fit.joint_fit(descent.flights, descent.priors, prior)
    begin = settled._replace(hyper=joint_fit._looser(descent.hyper, 3.0))
    usual, ended, said = marginal_mode.marginal_mode, [], []

    def astray(flights, priors, place, **most):
        best = usual(flights, priors, place, **most)
        if 1 <= len(ended) <= spoiled:
            aside = best.theta + sds * np.sqrt(np.diag(best.covariance))
            rest = conditional_mode.conditional_optimum(flights, place.hyper, priors, aside, best.flights)
            best = replace(best, theta=aside, flights=rest.flights)
        ended.append((best, place.hyper))
        return best

    monkeypatch.setattr(laplace_fit, "marginal_mode", astray)
    monkeypatch.setattr(laplace_fit, "_SETTLED", 0.0)
    monkeypatch.setattr(laplace_fit, "_GAINED", -np.inf)
    monkeypatch.setattr(laplace_fit, "_TURNS", 2)
    monkeypatch.setattr(laplace_fit, "_NOISE_STEPS", steps)
    best, hyper, _ = laplace_fit._by_turns(
        descent.flights, descent.priors, prior, begin, lambda share, words: said.append(words)
    )
    told = ["turn 1", "turn 2", "turn 2, 0.3 of the way", "turn 2, 0.1 of the way"]
    assert [words.split(": ")[0].split("at the mode, ")[1] for words in said] == told[: len(said)]
    gained = [float(words.removesuffix(", not kept").split()[-1]) for words in said]
    assert [words.endswith("not kept") for words in said[1 : 1 + spoiled]] == [True] * spoiled
    assert gained[0] > 1.0
    if spoiled == 3:
        assert gained[1:] == pytest.approx([-8.0] * 3, abs=0.5)  # half of four squared
        assert len(said) == 4 and best is ended[0][0] and hyper is ended[0][1]
    else:
        way = [to_vector(one) - to_vector(ended[0][1]) for _, one in ended[1:]]
        np.testing.assert_allclose(way[1], 0.3 * way[0], atol=1e-9)
        assert len(said) == 3 and gained[2] > 0.0 and best is ended[2][0] and hyper is ended[2][1]


@pytest.mark.parametrize(("far", "held"), [(0.1, False), (50.0, True)])
def test_noise_parameters_go_to_their_mean_unless_that_is_too_far(found, descent, monkeypatch, far, held):
    """A displacement by which the parameter would move `far` standard deviations."""
    (slope,) = found.noise_effect.slope
    moved = far * slope / float(slope @ slope)
    told, mode = {}, noise_evidence.maximise

    def remembered(*given, **named):
        told["mode"] = mode(*given, **named)
        return told["mode"]

    monkeypatch.setattr(noise_evidence, "maximise", remembered)
    monkeypatch.setattr(noise_evidence, "mean_less_mode", lambda *_: moved)
    settled = joint_fit.joint_fit(descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4))
    made = laplace_fit.marginal_fit(descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4), settled)
    went = to_vector(made.hyper) - to_vector(told["mode"][0])
    np.testing.assert_allclose(went, 0.0 if held else moved, atol=1e-9)


def test_parts_that_disagree_widen_the_posterior_unless_a_classical_method_is_wanted(found, descent, monkeypatch):
    settled = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    plain = Dispersion(1.0, 1.5, 1.0, np.zeros((1, 1)))
    wide = Dispersion(4.0, 1.5, 4.0, np.log([[4.0]]))
    made = {}
    for name, parts, widen in (("plain", plain, True), ("wide", wide, True), ("classical", wide, False)):
        monkeypatch.setattr(laplace_fit, "dispersion", lambda *given, parts=parts: parts)
        made[name] = laplace_fit.marginal_fit(
            descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4), settled, widen=widen
        )
    effects = {name: one.noise_effect for name, one in made.items()}
    np.testing.assert_allclose(effects["wide"].excess - effects["plain"].excess, np.log(4.0), atol=1e-9)
    np.testing.assert_allclose(effects["classical"].excess, effects["plain"].excess, atol=1e-9)
    np.testing.assert_allclose(effects["wide"].misfit, np.log(4.0))  # known apart from the noise parameters' part
    assert effects["classical"].misfit is None and not effects["plain"].misfit.any()
    still = np.zeros(effects["wide"].slope.shape[1])
    ratio = effects["wide"].carried(np.ones(1), still) / effects["plain"].carried(np.ones(1), still)
    assert ratio[0] == pytest.approx(2.0) and made["classical"].dispersion.disagree
