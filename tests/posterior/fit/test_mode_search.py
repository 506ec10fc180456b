"""The search ends at the mode of the marginal posterior, goes on where there is none, and says why where it can't."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.core.errors import FitError
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import mode_checks
from bayeschute.posterior.beyond_linear import polynomials
from bayeschute.posterior.beyond_linear.expansion import Expansion
from bayeschute.posterior.fit import joint_fit, marginal_mode, mode_search
from bayeschute.posterior.fit.mode_search import Candidate
from bayeschute.posterior.marginal import Quadratic
from bayeschute.posterior.mode_checks import Profile
from bayeschute.posterior.noise_evidence import NoisePrior


@pytest.mark.parametrize(("fail", "tried"), [((), [1.0]), ((1.0,), [1.0, 0.3])])
def test_the_density_is_looked_at_nearer_where_flights_fail(found, monkeypatch, fail, tried):
    usual, steps = polynomials.sides, []

    def sides(made, step, progress):
        steps.append(step)
        if step in fail:
            raise FloatingPointError("flights beside the optimum fail")
        return usual(made, step, progress)

    monkeypatch.setattr(polynomials, "sides", sides)
    np.testing.assert_array_equal(mode_search._sides(found.marginal).steps, tried[-1])
    assert steps == tried
    monkeypatch.setattr(mode_search, "_NEARER", 1.0)
    if fail:
        with pytest.raises(FloatingPointError, match="beside the optimum"):
            mode_search._sides(found.marginal)


def _bent(made, curvature):
    return replace(made, bend=Quadratic(np.zeros(1), np.array([[curvature]])))


def _beside(found, descent, sds):
    """The optimum that many standard deviations away, and the posterior there."""
    best = replace(found.optimum, theta=found.optimum.theta + sds * np.sqrt(found.optimum.covariance[0, 0]))
    return best, mode_search.marginalise(descent.flights, found.hyper, descent.priors, best)


def test_a_correction_that_outweighs_the_density_is_left_out_as_far_as_it_does(found):
    about = Expansion(np.zeros(1), np.array([[-1.0]]))
    made = mode_search._flattened(mode_search._Place(found.optimum, _bent(found.marginal, -2.0), about))
    assert made.lost == (mode_search._LOST_BEND,) and made.expansion.has_mode and made.away == 0.0
    assert made.marginal.bend.curvature[0, 0] == pytest.approx(-0.8)


@pytest.mark.parametrize("sds", [2.0, 0.7])
def test_a_step_is_taken_where_the_density_rises_as_it_should(found, descent, flown, sds):
    """Two standard deviations beside the mode, where the curvature is said to be negative, at least half of the way."""
    aside, near = _beside(found, descent, sds)
    about = Expansion(np.array([sds]), np.array([[-1.0 if sds > 1.0 else 1.0]]))
    made = mode_search._ahead(near, mode_search._Place(aside, near, about))
    sd = np.sqrt(found.optimum.covariance[0, 0])
    assert abs(made.theta - found.optimum.theta)[0] <= (1.1 if sds > 1.0 else 0.2) * sd
    for flight, at in zip(descent.flights, made.flights, strict=True):
        own = flown(flight, found.hyper, made.theta, at.unknowns)
        np.testing.assert_allclose(at.path, own.path, atol=0.05 * np.ptp(own.path))


NONE = Expansion(np.array([0.1]), -np.eye(1))


def test_no_step_is_taken_where_the_density_does_not_rise(found, descent, monkeypatch):
    """The mode stays the mode, wherever the polynomial says it is."""
    away = Expansion(np.array([0.9]), np.eye(1))
    assert mode_search._ahead(found.marginal, mode_search._Place(found.optimum, found.marginal, away)) is None
    assert mode_search._ahead(found.marginal, mode_search._Place(found.optimum, found.marginal, NONE)) is None
    begin = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    usual = polynomials.corrected
    monkeypatch.setattr(polynomials, "corrected", lambda made, near, progress=None: (usual(made, near=near)[0], away))
    best, _, _, lost, seen = mode_search.search(
        descent.flights, descent.priors, begin, [Candidate("those", found.hyper)]
    )
    assert lost == () and seen.is_mode
    assert abs(best.theta - found.optimum.theta)[0] < 0.3 * np.sqrt(found.optimum.covariance[0, 0])


def test_where_the_density_has_no_mode_the_search_goes_on(found, descent, monkeypatch):
    """From a place whose curvature is negative, to the next; only where none is higher the correction is left out."""
    begin = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    usual, seen = polynomials.corrected, []

    def told(near, beside, least):
        seen.append(near)
        made, about = usual(near, near=beside)
        if len(seen) <= least:
            return _bent(made, -2.0), about._replace(curvature=about.curvature - 2.0)
        return made, about

    given = descent.flights, descent.priors, begin, [Candidate("those", found.hyper)]
    monkeypatch.setattr(mode_search, "marginal_mode", lambda *given: _beside(found, descent, 2.0)[0])
    monkeypatch.setattr(polynomials, "expanded", lambda *given: Expansion(np.zeros(1), np.eye(1)))
    monkeypatch.setattr(polynomials, "corrected", lambda made, near, progress=None: told(made, near, 1))
    best, _, made, lost, _ = mode_search.search(*given)
    assert lost == () and len(seen) >= 2 and made.centre is not seen[0].centre
    assert abs(best.theta - found.optimum.theta)[0] < 0.5 * np.sqrt(found.optimum.covariance[0, 0])
    seen.clear()
    monkeypatch.setattr(mode_search, "marginal_mode", lambda *given: found.optimum)
    monkeypatch.setattr(polynomials, "corrected", lambda made, near, progress=None: told(made, near, 9))
    *_, made, lost, profile = mode_search.search(*given)
    assert lost == (mode_search._LOST_BEND,) and len(seen) == 1 and -1.0 < made.bend.curvature[0, 0] < -0.7
    assert profile.is_mode


@pytest.mark.parametrize("second", [True, False])
def test_corrections_are_left_out_only_where_no_noise_parameters_lead_to_a_mode(found, descent, monkeypatch, second):
    """The first have none, wherever they lead; the second have one, or not."""
    begin, usual = joint_fit.JointFit(found.optimum, found.hyper, found.evidence), polynomials.corrected
    other = joint_fit._looser(found.hyper, 3.0)

    def told(plain, near, progress=None):
        made, about = usual(plain, near=near)
        if second and plain.hyper is found.hyper:
            return made, about
        return _bent(made, -2.0), about._replace(curvature=about.curvature - 2.0)

    monkeypatch.setattr(mode_search, "marginal_mode", lambda *given: found.optimum)
    monkeypatch.setattr(mode_search, "_ahead", lambda *given: None)
    monkeypatch.setattr(polynomials, "corrected", told)
    candidates = [Candidate("mean", other), Candidate("mode", found.hyper, ("shift",))]
    _, hyper, made, lost, profile = mode_search.search(descent.flights, descent.priors, begin, candidates)
    assert profile.is_mode and made.hyper is hyper and hyper is (found.hyper if second else other)
    assert lost == (("shift",) if second else (mode_search._LOST_BEND,))


def test_a_way_on_that_leads_where_nothing_flies_ends_the_search_at_what_was_found(found, descent, monkeypatch):
    begin = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    usual = polynomials.corrected

    def told(made, near, progress=None):
        return usual(made, near=near)[0], Expansion(np.array([-0.3]), np.eye(1))

    def nowhere(*given):
        raise FloatingPointError("a step fails")

    monkeypatch.setattr(polynomials, "corrected", told)
    monkeypatch.setattr(mode_search, "_ahead", nowhere)
    best, *_, lost, _ = mode_search.search(descent.flights, descent.priors, begin, [Candidate("those", found.hyper)])
    assert lost == () and abs(best.theta - found.optimum.theta)[0] < 0.3 * np.sqrt(found.optimum.covariance[0, 0])


def test_the_search_goes_on_to_the_mode_that_the_corrections_tell_of(found, descent, settled):
    """From beside it, where the search by slopes alone has ended."""
    sd = np.sqrt(found.optimum.covariance[0, 0])
    begin = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    usual, moved = marginal_mode.marginal_mode, []

    def beside(flights, priors, settled, progress=None, most=0):
        best = usual(flights, priors, settled)
        moved.append(best.theta[0])
        return _beside(found, descent, 0.8)[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mode_search, "marginal_mode", beside)
        best, hyper, made, lost, seen = mode_search.search(
            descent.flights, descent.priors, begin, [Candidate("those", found.hyper)]
        )
    assert hyper is found.hyper and lost == () and len(moved) == 1
    assert abs(best.theta[0] - found.optimum.theta[0]) < 0.3 * sd
    assert seen.is_mode and seen.worst == pytest.approx(0.5, abs=0.05)


def test_noise_parameters_without_a_mode_give_way_to_the_next(found, descent, monkeypatch):
    settled = joint_fit.joint_fit(descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4))
    right, usual, seen = settled.hyper, mode_checks.profile, []

    def told(made, *middle):
        seen.extend([made.hyper] if made.hyper not in seen[-1:] else [])
        return usual(made, *middle) if made.hyper is right else Profile(np.eye(1), np.array([[2.0, -0.3, 0.5, 2.0]]))

    monkeypatch.setattr(mode_checks, "profile", told)
    other = joint_fit._looser(right, 3.0)
    _, hyper, made, lost, _ = mode_search.search(
        descent.flights, descent.priors, settled, [Candidate("mean", other), Candidate("mode", right, ("shift",))]
    )
    assert hyper is right and made.hyper is right and seen == [other, right] and lost == ("shift",)
    with pytest.raises(joint_fit.NoFitError, match=r"rises by 0\.3 along") as told_of:
        mode_search.search(descent.flights, descent.priors, settled, [Candidate("mean", other)])
    (line,) = told_of.value.tried
    assert line.startswith("mean: steps left from") and "rises by 0.3" in line
    assert told_of.value.hyper is other and np.isfinite(told_of.value.best.theta).all()


def test_noise_parameters_under_which_nothing_flies_give_way_to_the_next(found, descent, settled, monkeypatch):
    settled, usual = joint_fit.JointFit(found.optimum, found.hyper, found.evidence), marginal_mode.marginal_mode
    other = joint_fit._looser(found.hyper, 3.0)

    def lost(flights, priors, settled, progress=None, most=0):
        if settled.hyper is other:
            raise FloatingPointError("a step fails")
        return usual(flights, priors, settled)

    monkeypatch.setattr(mode_search, "marginal_mode", lost)
    assert (
        mode_search.search(
            descent.flights,
            descent.priors,
            settled,
            [Candidate("mean", other), Candidate("mode", found.hyper, ("shift",))],
        )[1]
        is found.hyper
    )
    with pytest.raises(joint_fit.NoFitError, match="a step fails"):
        mode_search.search(descent.flights, descent.priors, settled, [Candidate("mean", other)])


def test_a_search_whose_steps_stay_long_ended_beside_the_mode(found, descent, monkeypatch):
    """Of the points that it went by that with the shortest way ahead is judged."""
    ways = iter((1.5, 1.2, 1.4, 1.3, 1.6, 1.7, 1.5, 0.4, 1.1, 0.9, 1.2, 1.3))
    begin = joint_fit.JointFit(found.optimum, found.hyper, 0.0)

    def about():
        return Expansion(np.array([-next(ways)]), np.eye(1))

    monkeypatch.setattr(mode_search, "marginal_mode", lambda *given: found.optimum)
    monkeypatch.setattr(mode_search, "marginalise", lambda *given: found.marginal)
    monkeypatch.setattr(polynomials, "corrected", lambda made, near, progress=None: (made, about()))
    monkeypatch.setattr(mode_search, "_ahead", lambda near, place: replace(place.optimum, cost=place.step[0]))
    monkeypatch.setattr(mode_checks, "profile", lambda made, *middle: SimpleNamespace(is_mode=True, worst=0.5))
    with pytest.raises(FitError, match=r"after 6 steps towards it the mode is still off by 1\.2 standard deviations"):
        mode_search.search(descent.flights, descent.priors, begin, [Candidate("those", found.hyper)])
    best, *_ = mode_search.search(descent.flights, descent.priors, begin, [Candidate("those", found.hyper)])
    assert best.cost == 1.5  # the step that led to the point from which 0.4 are left


def test_how_far_the_mode_is_from_a_place_is_told_with_or_more_where_the_step_was_cut(found):
    def told(slope):
        return mode_search._Place(found.optimum, found.marginal, Expansion(np.array(slope), np.eye(2))).distance

    assert told([-1.2, 0.0]) == "0.85 standard deviations"
    assert told([-2.99, 0.0]) == "2.1 standard deviations" and told([-7.0, 0.0]) == "2.1 standard deviations or more"


def test_an_axis_is_told_by_the_parameters_that_change_along_it_by_half_as_much_as_the_most():
    priors = [Prior(name, 0.0, 1.0, False, "1", "test") for name in "abcd"]
    root = np.diag([10.0, 1.0, 0.1, 1.0])  # changes count in standard deviations
    made = SimpleNamespace(scale=root)
    assert mode_search._in_names(priors, made, np.array([0.3, 0.9, 0.5, 0.1])) == " (an axis of b, c)"
    assert mode_search._in_names(priors, made, None) == "" == mode_search._in_names(priors[:1], made, np.ones(1))


@pytest.mark.parametrize("flies", [True, False])
def test_places_far_from_the_mode_are_passed_by_without_corners(found, descent, monkeypatch, flies):
    """Those cost most; where nothing flies further on, the last such place gets them after all."""
    begin, usual, whole = joint_fit.JointFit(found.optimum, found.hyper, 0.0), mode_search._ahead, []
    corrected = polynomials.corrected
    aside, _ = _beside(found, descent, 1.5)

    def ahead(near, place):
        if not flies:
            raise FloatingPointError("a step fails")
        return usual(near, place)

    def told(made, near, progress=None):
        whole.append(made)
        return corrected(made, near=near)

    monkeypatch.setattr(mode_search, "marginal_mode", lambda *given: aside)
    monkeypatch.setattr(mode_search, "_ahead", ahead)
    monkeypatch.setattr(polynomials, "corrected", told)
    places, highest, steps = mode_search._places(descent.flights, descent.priors, begin, lambda share, words: None)
    assert len(whole) == len(places) == 1 and not highest and steps == (2 if flies else 1)
    away = (places[0].optimum.theta - found.optimum.theta)[0] / np.sqrt(found.optimum.covariance[0, 0])
    assert abs(away) < 0.3 if flies else away == pytest.approx(1.5)


@pytest.mark.parametrize("among", ["candidates", "others", "flattened candidates"])
def test_other_noise_parameters_are_tried_only_where_no_candidate_leads_to_a_mode(found, descent, monkeypatch, among):
    """Not even one about which corrections are left out; the error tells of the candidates, the list of all."""
    begin = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    first, second = found.hyper, joint_fit._looser(found.hyper, 1.2)
    usual, corrected, sought = mode_checks.profile, polynomials.corrected, []
    cliff = Profile(np.eye(1), np.array([[2.0, -0.3, 0.5, 2.0]]))

    def told(made, *middle):
        return cliff if among == "others" and made.hyper is first else usual(made, *middle)

    def bent(made, near, progress=None):
        sought.append(made.hyper)
        made, about = corrected(made, near=near)
        return (
            (_bent(made, -2.0), about._replace(curvature=about.curvature - 2.0)) if "flat" in among else (made, about)
        )

    monkeypatch.setattr(mode_checks, "profile", told)
    monkeypatch.setattr(polynomials, "corrected", bent)
    if "flat" in among:
        monkeypatch.setattr(mode_search, "_ahead", lambda *given: None)
    given = descent.flights, descent.priors, begin, [Candidate("mode", first)], [Candidate("more", second, ("raised",))]
    ended = mode_search.search(*given)
    assert ended.hyper is (second if among == "others" else first) and (second in sought) == (among == "others")
    wanted = {"candidates": (), "others": ("raised",), "flattened candidates": (mode_search._LOST_BEND,)}
    assert ended.lost == wanted[among]


def test_where_nothing_leads_to_a_mode_the_error_is_that_of_the_candidates(found, descent, monkeypatch):
    begin = joint_fit.JointFit(found.optimum, found.hyper, found.evidence)
    other = joint_fit._looser(found.hyper, 1.2)

    def told(made, *middle):
        return Profile(np.eye(1), np.array([[2.0, -0.3 if made.hyper is other else -0.7, 0.5, 2.0]]))

    monkeypatch.setattr(mode_checks, "profile", told)
    given = descent.flights, descent.priors, begin, [Candidate("mode", found.hyper)], [Candidate("more", other)]
    with pytest.raises(joint_fit.NoFitError, match=r"rises by 0\.7") as error:
        mode_search.search(*given)
    assert [line.split(":")[0] for line in error.value.tried] == ["mode", "more"]
    assert "rises by 0.3" in error.value.tried[1] and error.value.hyper is found.hyper
