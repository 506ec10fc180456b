"""The marginal posterior is found from data and priors: its mode, its noise parameters, its determinant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from scipy.optimize import brentq

from bayeschute.errors import FitError
from bayeschute.inference import determinant, finding, lifted
from bayeschute.inference.evidence import HyperPrior
from bayeschute.inference.marginal import log_density
from bayeschute.inference.score import to_vector


def test_found(found, descent):
    assert found.optimum.converged
    assert abs(found.optimum.theta[0] - descent.theta[0]) < 4.0 * np.sqrt(found.optimum.covariance[0, 0])
    assert found.law_covariance.shape == (5, 5) and np.isfinite(found.evidence)
    assert np.linalg.eigvalsh(found.law_covariance).min() > 0.0
    slope, spread, excess = found.law_effect
    assert slope.shape == (1, 5) and 0.01 < np.abs(slope).max() < 2.0
    assert spread.shape == (5, 1, 1) and 0.1 < np.abs(spread).max() < 2.5
    assert excess.shape == (1, 1) and abs(excess[0, 0]) < 0.2
    assert 0.0 < found.determinant_error < 0.05


def test_the_optimum_is_the_mode_of_the_marginal_posterior(found):
    """With the determinant the density is level there; without it, it is not."""

    def slope(marginal):
        ends = np.asarray(log_density(marginal, np.array([[-0.1, 0.1]])))
        return (ends[1] - ends[0]) / 0.2

    flat = jax.tree.map(np.zeros_like, found.marginal.determinant)
    for stored, anew in zip(found.marginal.determinant, determinant.around(found.marginal), strict=True):
        np.testing.assert_allclose(stored, anew, rtol=1e-9)
    assert abs(slope(found.marginal)) < 0.01
    assert abs(slope(replace(found.marginal, determinant=flat))) > 0.03


def test_progress_grows(descent):
    heard = []
    prior = HyperPrior(descent.hyper, 0.4)
    finding.find(descent.flights, descent.priors, prior, rounds=1, progress=lambda share, words: heard.append(share))
    assert heard == sorted(heard) and 0.0 <= heard[0] and heard[-1] <= 1.0


@pytest.mark.parametrize(
    ("least", "shares"),
    [
        (0.0, [0.2, 0.5, 1.0]),
        (0.15, [0.2, 0.1, 0.2, 0.5, 1.0]),  # the flight that begins fails before 20 % of the record
        (0.06, [0.2, 0.1, 0.05, 0.1, 0.2, 0.5, 1.0]),
    ],
)
def test_openings_are_shortened_where_the_first_flight_fails(descent, monkeypatch, least, shares):
    """What flies from the beginning ends within a share `least` of the record; once fitted it goes twice as far."""
    tried, reach = [], [least or 1.0]

    def fit(flights, hyper, priors, theta, unknowns, **options):
        seen = np.asarray(flights[0].present).any(axis=1)
        share = (np.flatnonzero(seen)[-1] + 1) / seen.size
        tried.append(share)
        assert options["opening"] == (share < 1.0)
        if share > reach[0]:
            raise FloatingPointError("lost")
        reach[0] = 2.5 * share if share < 0.15 else 1.0
        return SimpleNamespace(theta=theta, unknowns=[f.still() for f in flights])

    monkeypatch.setattr(finding.optimum, "fit", fit)
    finding.lengthened(descent.flights, descent.priors, descent.hyper, descent.theta, lambda *_: None)
    assert tried == pytest.approx(shares, abs=0.03)


def test_an_opening_of_a_twentieth_that_fails_ends_the_search(descent, monkeypatch):
    tried = []

    def fit(flights, *_, **options):
        tried.append(1)
        raise FloatingPointError("lost")

    monkeypatch.setattr(finding.optimum, "fit", fit)
    with pytest.raises(FloatingPointError, match="lost"):
        finding.lengthened(descent.flights, descent.priors, descent.hyper, descent.theta, lambda *_: None)
    assert len(tried) == 4


def test_an_opening_that_led_astray_is_begun_anew_in_small_steps(descent, monkeypatch):
    """Steps of more than a sixth of the record lead to where no longer opening flies; small ones begin where all did."""
    tried, astray = [], [False]

    def fit(flights, hyper, priors, theta, unknowns, **options):
        seen = np.asarray(flights[0].present).any(axis=1)
        share = (np.flatnonzero(seen)[-1] + 1) / seen.size
        before = tried[-1] if tried and unknowns is not None else 0.0
        if unknowns is None:
            np.testing.assert_array_equal(theta, descent.theta)
            astray[0] = False
        if astray[0]:
            raise FloatingPointError("lost")
        astray[0] = share - before > 1.0 / 6.0
        tried.append(share)
        return SimpleNamespace(theta=theta + 1.0, unknowns=[f.still() for f in flights])

    monkeypatch.setattr(finding.optimum, "fit", fit)
    found, _ = finding.lengthened(descent.flights, descent.priors, descent.hyper, descent.theta, lambda *_: None)
    assert tried == pytest.approx([0.2, *np.linspace(0.1, 1.0, 10)], abs=0.03)
    np.testing.assert_allclose(found, descent.theta + 10.0)


def test_the_mode_is_found_far_from_the_joint_optimum(descent, monkeypatch):
    """A log determinant whose slope dies away: one slope goes much too far, the mode is where slope and cost balance."""
    settled = finding.settle(descent.flights, descent.priors, HyperPrior(descent.hyper))
    factor = np.linalg.cholesky(settled.optimum.covariance)
    start = settled.optimum.theta

    def bent(made):
        """Slope of 6 per standard deviation at the joint optimum, of half that at two standard deviations."""
        away = np.linalg.solve(factor, np.asarray(made.centre) - start)
        return 6.0 * np.exp(away * np.log(2.0) / 2.0)

    monkeypatch.setattr(determinant, "slope", bent)
    best = finding.marginal_mode(descent.flights, descent.priors, settled)
    away = float(np.linalg.solve(factor, best.theta - start)[0])
    balance = brentq(lambda x: x + 6.0 * np.exp(x * np.log(2.0) / 2.0), -6.0, 0.0)
    assert best.converged and abs(away - balance) < 0.2 < abs(-6.0 - balance)


@pytest.mark.parametrize(("share", "mode"), [(0.3, -2.5), (0.25, 2.5)])
def test_the_mode_is_found_across_a_slope_much_flatter_than_gauss_newton_expects(descent, monkeypatch, share, mode):
    """Cost and log determinant together rise with a share of the cost's curvature: Gauss-Newton steps stop short."""
    settled = finding.settle(descent.flights, descent.priors, HyperPrior(descent.hyper))
    factor, start = np.linalg.cholesky(settled.optimum.covariance), settled.optimum.theta

    def flat(made):
        away = np.linalg.solve(factor, np.asarray(made.centre) - start)
        return share * (away - mode) - away

    monkeypatch.setattr(determinant, "slope", flat)
    best = finding.marginal_mode(descent.flights, descent.priors, settled)
    away = float(np.linalg.solve(factor, best.theta - start)[0])
    assert best.converged and abs(away - mode) < 0.2


@pytest.mark.parametrize(("far", "held"), [(0.1, False), (50.0, True)])
def test_noise_parameters_go_to_their_mean_unless_that_is_too_far(found, descent, monkeypatch, far, held):
    """A displacement by which the parameter would move `far` standard deviations."""
    (slope,) = found.law_effect.slope
    moved = far * slope / float(slope @ slope)
    told, mode = {}, finding.evidence.maximise

    def remembered(*given, **named):
        told["mode"] = mode(*given, **named)
        return told["mode"]

    monkeypatch.setattr(finding.evidence, "maximise", remembered)
    monkeypatch.setattr(finding.evidence, "mean_less_mode", lambda *_: moved)
    settled = finding.settle(descent.flights, descent.priors, HyperPrior(descent.hyper, 0.4))
    made = finding.conclude(descent.flights, descent.priors, HyperPrior(descent.hyper, 0.4), settled)
    went = to_vector(made.hyper) - to_vector(told["mode"][0])
    np.testing.assert_allclose(went, 0.0 if held else moved, atol=1e-9)


@pytest.mark.parametrize("goes_on", [False, True])
def test_a_fit_that_begins_anew_begins_with_stronger_noise_and_goes_on_in_smaller_steps(monkeypatch, descent, goes_on):
    """From a path that is known its own noise is right; of all that is tried the first that gets there is kept."""
    at, tried = lifted.Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1))), []

    def third(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        tried.append((float(np.asarray(hyper.noise.white)[0]) / 0.05, places is not None, tuple(levels)))
        row = lifted.Row(0.0, 12.0, 1e-4 if len(tried) == 3 else 0.5, 1.0, 1.0, 1.0)
        return lifted.LiftedFit(theta, (at,), np.eye(len(priors)), (row,), True)

    monkeypatch.setattr(lifted, "descend", third)
    monkeypatch.setattr(lifted, "tightened", lambda flights, hyper, priors, made: made)
    monkeypatch.setattr(finding.optimum, "total_cost", lambda *_: 12.0)
    given = descent.flights, descent.hyper, descent.priors, np.zeros(1), [at] if goes_on else None
    assert finding._along_record(*given, lifted.NEAR, print).rows[-1].defect == 1e-4
    whole = (*lifted.LEVELS, 0.0)
    first, second, last = tried
    assert second == (pytest.approx(1.0), False, whole)
    assert first == ((pytest.approx(1.0), True, (0.0,)) if goes_on else (pytest.approx(3.0), False, whole))
    assert last[:2] == (pytest.approx(1.0 if goes_on else 3.0), False)
    assert len(last[2]) > len(whole) and last[2][-1] == 0.0 and sorted(last[2], reverse=True) == list(last[2])


def test_looser_noise_has_larger_standard_deviations_and_the_same_times(descent):
    made, hyper = finding._looser(descent.hyper), descent.hyper
    np.testing.assert_allclose(made.noise.white, 3.0 * hyper.noise.white)
    np.testing.assert_allclose(made.noise.correlated, 3.0 * hyper.noise.correlated)
    np.testing.assert_array_equal(made.noise.time_constant, hyper.noise.time_constant)
    np.testing.assert_allclose(made.laws[0], hyper.laws[0] * [3.0, 1.0])


def test_a_record_that_no_flight_follows_is_told(monkeypatch, descent):
    """Whatever was tried is listed, the best path is kept, and nothing goes on from there."""
    at = lifted.Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1)))
    defects = iter((0.9, 0.5, 0.7))

    def stuck(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        row = lifted.Row(0.0, 12.0, next(defects), 1.0, 1.0, 1.0)
        return lifted.LiftedFit(theta, (at,), np.eye(len(priors)), (row,), False)

    monkeypatch.setattr(lifted, "descend", stuck)
    theta = np.zeros(len(descent.priors))
    with pytest.raises(finding.UnsettledError, match="no flight of the model follows the record") as told:
        finding._along_record(descent.flights, descent.hyper, descent.priors, theta, [at], lifted.NEAR, print)
    assert len(told.value.tried) == 3 and "defect 0.5" in told.value.tried[1]
    assert told.value.best.rows[-1].defect == 0.5 and told.value.priors == tuple(descent.priors)


def test_a_flight_that_strays_from_its_path_is_told_with_what_to_do(monkeypatch, descent):
    at = lifted.Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1)))

    def there(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        return lifted.LiftedFit(theta, (at,), np.eye(len(priors)), (lifted.Row(0.0, 12.0, 1e-4, 1.0, 1.0, 1.0),), True)

    monkeypatch.setattr(lifted, "descend", there)
    monkeypatch.setattr(lifted, "tightened", lambda flights, hyper, priors, made: made)
    monkeypatch.setattr(finding.optimum, "total_cost", lambda *_: 112.0)
    theta = np.zeros(len(descent.priors))
    with pytest.raises(finding.UnsettledError, match="obeys .* shorter window, or split the record") as told:
        finding._along_record(descent.flights, descent.hyper, descent.priors, theta, [at], lifted.NEAR, print)
    assert told.value.obeys and all("it strays, by 100 in cost" in words for words in told.value.tried)


def test_a_fit_that_took_no_step_is_not_the_best(monkeypatch, descent):
    at, rows = lifted.Lifted(descent.flights[0].still(), np.zeros((1, 1)), np.zeros((1, 1))), iter((None, 0.9, None))

    def seldom(flights, hyper, priors, theta, places, levels, near=None, progress=None):
        defect = next(rows)
        made = () if defect is None else (lifted.Row(0.0, 12.0, defect, 1.0, 1.0, 1.0),)
        return lifted.LiftedFit(theta, (at,), np.eye(len(priors)), made, False)

    monkeypatch.setattr(lifted, "descend", seldom)
    theta = np.zeros(len(descent.priors))
    with pytest.raises(finding.UnsettledError, match="break the equations of motion") as told:
        finding._along_record(descent.flights, descent.hyper, descent.priors, theta, [at], lifted.NEAR, print)
    assert told.value.best.rows[-1].defect == 0.9 and not told.value.obeys


def test_noise_parameters_without_a_mode_give_way_to_the_next(found, descent, monkeypatch):
    settled, seen = finding.settle(descent.flights, descent.priors, HyperPrior(descent.hyper, 0.4)), []
    right, usual = settled.hyper, finding._corrected

    def refuse(made, converged):
        seen.append(made.hyper)
        if made.hyper is not right:
            raise finding._NoModeError("no mode", found.profile)
        return usual(made, converged)

    monkeypatch.setattr(finding, "_corrected", refuse)
    other = finding._looser(right)
    _, hyper, made, lost = finding._last(descent.flights, descent.priors, settled, [other, right])
    assert hyper is right and made.hyper is right and seen == [other, right] and finding._LOST_MEAN in lost
    with pytest.raises(FitError, match="no mode"):
        finding._last(descent.flights, descent.priors, settled, [other])


def test_beside_the_mode_the_density_is_seen_to_be_higher_towards_it(found, descent):
    """One look takes the search at least half of two standard deviations back; at the mode there is nothing higher."""
    assert finding._higher(found.marginal, found.optimum, found.profile) is None
    sd = np.sqrt(np.diag(found.optimum.covariance))
    aside = replace(found.optimum, theta=found.optimum.theta + 2.0 * sd)
    near = finding.marginalise(descent.flights, found.hyper, descent.priors, aside)
    higher = finding._higher(near, aside, finding.profile(near))
    assert higher is not None
    assert np.max(np.abs(higher.theta - found.optimum.theta) / sd) <= 1.0
    assert np.isfinite(np.asarray(higher.unknowns[0].shocks)).all()


def test_a_search_that_ended_beside_the_mode_is_begun_again_where_it_is_higher(found, descent, monkeypatch):
    settled, usual, began = found.optimum, finding._corrected, []
    tries = iter((False, True))

    def once(made, converged):
        if next(tries):
            return usual(made, converged)
        raise finding._NoModeError("no mode", found.profile)

    def mode(flights, priors, settled, progress=None, most=0):
        began.append(settled.optimum)
        return found.optimum

    elsewhere = replace(settled, cost=-1.0)
    monkeypatch.setattr(finding, "_corrected", once)
    monkeypatch.setattr(finding, "marginal_mode", mode)
    monkeypatch.setattr(finding, "_higher", lambda near, best, seen: elsewhere)
    begin = finding.Settled(settled, found.hyper, 0.0)
    _, _, _, lost = finding._last(descent.flights, descent.priors, begin, [found.hyper])
    assert began == [settled, elsewhere] and lost == ()
