"""A search for terms in the fit, with stand-ins for the flights: what it is asked, where it goes on, what it leaves."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.aero.coefficient import Coefficient
from bayeschute.likelihood.joint import Lifted, NoiseParameters, Unknowns
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior, covariance, given_zero
from bayeschute.posterior.along_record.lifted_fit import LiftedFit, Row
from bayeschute.posterior.fit.joint_fit import JointFit, NoFitError
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.term_search import choose
from bayeschute.study.assembly.fits import Group
from bayeschute.study.run.fit import settled_terms

PRIORS = tuple(
    Prior(name, 0.1 * i, 1.0, False, "1", "x")
    for i, name in enumerate(("axial[1]", "axial[q]", "transverse[e]", "transverse[c]", "riser_length"))
)
MODE = np.array([0.9, 0.001, 0.4, -0.5, 71.0])
LAW = 1e-4 * (np.eye(5) + 0.3)
CORE = ("axial[1]", "transverse[e]")
HYPER = NoiseParameters(Noise(*np.full((3, 1), 0.1)), ())
FLIGHTS = (SimpleNamespace(name="one"), SimpleNamespace(name="two"))
PLACES = tuple(
    Lifted(Unknowns(np.full(1, i), np.zeros((3, 0))), np.zeros((3, 0)), np.full((3, 2), i)) for i in (0.0, 1.0)
)


def _optimum(theta, law):
    return Optimum(theta, PLACES, law, 1.0, True, 3, 0.01, (1.0,))


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A run of two flights whose fits are made up; `settled`: what they were asked."""
    (tmp_path / "fit").mkdir()
    asked = []

    def joint_fit(flights, priors, prior, progress, begin=None):
        progress(1.0, "settled")
        asked.append(SimpleNamespace(flights=flights, priors=tuple(priors), begin=begin))
        size = len(priors)
        return JointFit(_optimum(np.full(size, 7.0), np.eye(size)), HYPER, -float(len(asked)))

    def carried_over(flights, priors, prior, larger, theta, at):
        asked.append(SimpleNamespace(flights=flights, priors=tuple(priors), begin=(theta, at, larger.hyper)))
        return JointFit(_optimum(theta, np.eye(len(priors))), larger.hyper, -float(len(asked)))

    small = []

    def beside_smaller(flights, priors, prior, library, fewest, progress):
        assert library.evidence == -1.0 and len(priors) == 5
        small.append(fewest)
        progress(1.0, "beside")
        return library._replace(evidence=-9.0)

    def mode(flights, priors, settled, progress=None, near=0.0):
        assert settled.evidence == -9.0 and len(priors) == 5  # of the library, where the small model led
        return _optimum(MODE, LAW)

    monkeypatch.setattr(settled_terms, "joint_fit", joint_fit)
    monkeypatch.setattr(settled_terms, "marginal_mode", mode)
    monkeypatch.setattr(settled_terms, "carried_over", carried_over)
    monkeypatch.setattr(settled_terms, "beside_smaller", beside_smaller)
    monkeypatch.setattr(
        settled_terms, "data_of", lambda job, flight, priors: (flight.name, tuple(p.name for p in priors))
    )
    study = SimpleNamespace(
        structure=SimpleNamespace(fit="search", core=CORE, saturate=None), noise=SimpleNamespace(model="latent"),
        priors=SimpleNamespace(hierarchical=False, vary=None, vary_canopies=None), sampler=SimpleNamespace(starts=None), model="cluster",
        knowledge=(),
    )  # fmt: skip
    job = SimpleNamespace(
        study=study, save=lambda name, value: (tmp_path / name).write_text(json.dumps(value), encoding="utf-8")
    )
    made = SimpleNamespace(job=job, settled=asked, small=small, told=[], folder=tmp_path)
    return made


def _settled(run, priors=PRIORS):
    group = Group("all", FLIGHTS, priors)
    return settled_terms.settle(run.job, group, None, lambda share, words: run.told.append((share, words)))


def test_the_library_is_fitted_once_then_what_it_asks_for(run):
    group, settled, evidence = _settled(run)
    first, second = run.settled
    names = [p.name for p in group.priors]
    assert names == ["axial[1]", "transverse[e]", "transverse[c]", "riser_length"]  # q is zero within its error
    assert first.priors == PRIORS and first.begin is None and second.priors == group.priors
    assert settled.evidence == -2.0
    wanted = choose(PRIORS, MODE, LAW, ("axial[q]", "transverse[c]"))
    assert evidence == wanted.evidence and set(evidence) == {"axial[q]", "transverse[c]"}
    assert evidence["axial[q]"] < 0.0 < 2.0 < evidence["transverse[c]"]
    np.testing.assert_allclose(covariance(group.priors), covariance(given_zero(PRIORS, ["axial[q]"])))
    assert second.flights == [("one", tuple(names)), ("two", tuple(names))]
    shares = [share for share, _ in run.told]
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_the_air_that_moves_with_a_canopy_is_held_until_the_terms_are_chosen(run):
    air = Prior("enclosed_air_factor", 0.0, 0.5, True, "1", "given")
    group, *_ = _settled(run, (*PRIORS[:4], air))
    library, chosen = run.settled
    assert library.priors[:4] == PRIORS[:4] and library.priors[4] == replace(air, scale=settled_terms._HELD_SD)
    assert group.priors == chosen.priors and group.priors[-1] == air
    assert json.loads((run.folder / "fit" / "priors.json").read_text(encoding="utf-8"))[-1]["scale"] == 0.5


LEVEL = [replace(p, centre=0.1, saturation=0.4) for p in PRIORS[:4]]


@pytest.mark.parametrize(("share", "levels"), [(0.06, True), (0.05, False), (None, False)])
def test_powers_level_off_where_flights_are_lost(run, monkeypatch, share, levels):
    """The library is then fitted again by what equation error says of powers that level off; None: not to be tried."""
    other = [None] if share is None else [Group("all", FLIGHTS, (*LEVEL, PRIORS[4])), None]
    monkeypatch.setattr(settled_terms.saturation, "needed", lambda job, group: other.pop(0))
    monkeypatch.setattr(settled_terms.saturation, "lost", lambda made, hyper, seed: share)
    monkeypatch.setattr(settled_terms, "marginalise", lambda *given: given)
    monkeypatch.setattr(settled_terms, "beside_smaller", lambda flights, priors, prior, library, fewest, say: library)
    monkeypatch.setattr(settled_terms, "marginal_mode", lambda *a, **k: _optimum(MODE, LAW))
    run.job.study.seed = 1
    group, *_ = _settled(run)
    assert run.settled[0].priors == PRIORS and len(run.settled) == (3 if levels else 2)
    assert {p.saturation for p in group.priors[:-1]} == {0.4 if levels else None} and group.priors[-1] == PRIORS[4]
    if levels:
        assert run.settled[1].priors == (*LEVEL, PRIORS[4]) and run.settled[1].begin is None
    words = [one for _, one in run.told if one.endswith("are lost")]
    assert words == (
        [] if share is None else [f"{100 * share:.0f} % of flights with the full library of terms are lost"]
    )
    shares = [done for done, _ in run.told]
    assert shares == sorted(shares) and shares[-1] == 1.0


@pytest.mark.parametrize("known", [(), (SimpleNamespace(use="prior"),)])
def test_a_prior_that_the_flights_contradict_is_wider(run, known):
    """By a t distribution of four degrees of freedom; axial coefficients are where theirs says, so these keep it.

    What others know is in the prior too, where the study says so: it stays as it is.
    """
    run.job.study.knowledge = known
    priors = (*PRIORS[:2], *(replace(p, scale=0.05) for p in PRIORS[2:4]), PRIORS[4])
    group, *_ = _settled(run, priors)
    more = 1.0 if known else np.sqrt((4.0 + 4.0**2 + 16.0**2) / (4.0 + 2.0))
    told = {p.name: (p.scale, p.widened) for p in group.priors}
    assert told["transverse[e]"] == told["transverse[c]"] == pytest.approx((0.05 * more, more))
    assert told["axial[1]"] == (1.0, 1.0)


def test_the_smallest_model_has_the_core_and_what_canopies_do_to_each_other(run):
    _settled(run)
    (fewest,) = run.small
    wanted = ("axial[1]", "transverse[e]", "transverse[c]", "riser_length")
    assert tuple(p.name for p in fewest.priors) == wanted and fewest.kept.tolist() == [True, False, True, True, True]
    assert fewest.flights == [("one", wanted), ("two", wanted)]
    np.testing.assert_allclose(covariance(fewest.priors), covariance(given_zero(PRIORS, ["axial[q]"])))


def test_it_goes_on_from_the_library_s_flights(run):
    group, *_ = _settled(run)
    theta, places, hyper = run.settled[1].begin
    np.testing.assert_allclose(theta, choose(PRIORS, MODE, LAW, ("axial[q]", "transverse[c]")).theta)
    assert theta.size == len(group.priors) and hyper is HYPER
    assert tuple(places) == PLACES


def test_a_library_whose_paths_break_the_equations_of_motion_is_told(run, monkeypatch):
    whole, row = settled_terms.joint_fit, Row(0.0, 1.0, 0.5, 0.1, 0.1, 1.0)
    best = LiftedFit(MODE, PLACES, LAW, (row,), True)

    def breaks(flights, priors, *rest, **more):
        if len(priors) == len(PRIORS):
            raise NoFitError("steps break the equations of motion", ["once"], best, priors, HYPER)
        return whole(flights, priors, *rest, **more)

    monkeypatch.setattr(settled_terms, "joint_fit", breaks)
    with pytest.raises(NoFitError, match="break the equations of motion"):
        _settled(run)


def test_the_priors_that_were_used_are_kept(run):
    group, *_ = _settled(run)
    kept = json.loads((run.folder / "fit/priors.json").read_text(encoding="utf-8"))
    assert tuple(Prior(**row) for row in kept) == group.priors


def test_the_core_stays_whatever_the_evidence(run):
    run.job.study.structure.core = (*CORE, "axial[q]")
    group, _, evidence = _settled(run)
    assert len(group.priors) == 5 and set(evidence) == {"transverse[c]"}


def test_several_starts_are_told_where_the_library_led(run, monkeypatch):
    asked = []

    def several(job, group, prior, begins, say):
        asked.append((len(group.priors), begins))
        return JointFit(_optimum(np.zeros(len(group.priors)), np.eye(len(group.priors))), HYPER, -1.0)

    monkeypatch.setattr(settled_terms.several_starts, "settled", several)
    run.job.study.sampler.starts = 3
    _settled(run)
    assert [size for size, _ in asked] == [5, 4] and asked[0][1] == [None]
    assert asked[1][1][0][0].size == 4 and run.settled == []


@pytest.mark.parametrize("change", ["hierarchical", "white", "pool"])
def test_where_there_is_no_search_the_whole_library_is_fitted(run, change, monkeypatch):
    """Populations share their terms, output error has no evidence of the flight, a pool is fitted whole."""
    study = run.job.study
    study.priors.hierarchical = change == "hierarchical"
    study.noise.model = "white" if change == "white" else "latent"
    study.structure.fit = "pool" if change == "pool" else "search"
    monkeypatch.setattr(settled_terms, "terms_left_out", lambda job: [PRIORS[0]])  # none that is not there already
    group, settled, scores = _settled(run)
    assert group.priors == PRIORS and scores == {} and settled.evidence == -1.0 and len(run.settled) == 1
    assert not (run.folder / "fit/priors.json").exists()


def test_a_term_that_was_left_out_is_added_by_its_score_and_the_fit_begins_where_it_was(run, monkeypatch):
    """A score is a step over its standard error: five of them ask for a term, three do not."""
    run.job.study.structure.fit = "selected"
    fitted, (asked_for, not_asked_for) = (PRIORS[0], PRIORS[2], PRIORS[4]), (PRIORS[1], PRIORS[3])
    steps = {asked_for.name: (-0.5, 0.1), not_asked_for.name: (0.9, 0.3)}
    changed, scored = [], []

    def with_terms(study, priors, more):
        return [*priors, *more], np.arange(len(priors) + len(more)) < len(priors)

    def scores(flights, hyper, whole, theta, places, kept):
        scored.append((theta.tolist(), kept.tolist()))
        return np.array([steps.get(p.name, (0.0, 1.0)) for p in whole]).T

    monkeypatch.setattr(settled_terms, "terms_left_out", lambda job: [asked_for, not_asked_for])
    monkeypatch.setattr(settled_terms, "with_terms", with_terms)
    monkeypatch.setattr(settled_terms, "scores", scores)
    monkeypatch.setattr(settled_terms, "revise", lambda job, priors: changed.append(list(priors)))
    group, settled, z = _settled(run, fitted)
    assert group.priors == (*fitted, asked_for) and changed == [[*fitted, asked_for]]
    assert z == {not_asked_for.name: pytest.approx(3.0)}
    begins = [one.begin for one in run.settled]
    assert begins[:2] == [None, None] and begins[2][0].tolist() == [7.0, 7.0, 7.0, 0.0]
    assert settled.evidence == -3.0 and len(begins) == 3  # the greatest of all begins
    assert scored[0] == ([7.0, 7.0, 7.0, 0.0, 0.0], [True] * 3 + [False] * 2)


@pytest.fixture
def demanding(run, monkeypatch):
    """A searched group without two of its terms, of which scores on two flights are made up: (estimate, se) by name."""
    scores = {"axial[q]": [(0.2, 0.1), (-0.3, 0.1)], "transverse[c]": [(0.1, 0.1), (-0.9, 0.2)]}

    def missing_terms(flight, library):
        assert library == {"axial": ["q"], "transverse": ["c"]}
        for kind, terms in library.items():
            for term in terms:
                yield (
                    Coefficient(kind, term),
                    SimpleNamespace(what=f"the coefficient of {term}", name=f"{kind}[{term}]"),
                )

    def tested(marginal, number, lacking):
        assert marginal == (chosen.priors, place.optimum)
        rows = [(one.what, *scores[one.name][number]) for one in lacking if scores[one.name] is not None]
        return [SimpleNamespace(what=what, estimate=estimate, se=se) for what, estimate, se in rows]

    monkeypatch.setattr(settled_terms, "missing_terms", missing_terms)
    monkeypatch.setattr(settled_terms.alternatives, "scores", tested)
    out = ["axial[q]", "transverse[c]"]
    wide = [replace(p, scale=2.0 * p.scale, widened=2.0) if p.name.startswith("transverse") else p for p in PRIORS]
    chosen = Group("all", FLIGHTS, tuple(given_zero(wide, out)))
    place = JointFit(_optimum(np.array([0.8, 0.3, 70.0]), np.eye(3)), HYPER, -2.0)
    monkeypatch.setattr(settled_terms, "marginalise", lambda flights, hyper, priors, best: (priors, best))

    def again(asked=PRIORS):
        return settled_terms.with_demanded(run.job, Group("all", FLIGHTS, asked), chosen, place, None)

    return SimpleNamespace(scores=scores, again=again, chosen=chosen, run=run)


def test_a_term_far_off_zero_on_any_flight_comes_back_where_the_fit_without_it_led(demanding):
    """With the priors that it had in the library, as wide as those of the terms that stayed."""
    group, place = demanding.again()
    assert [p.name for p in group.priors] == ["axial[1]", "transverse[e]", "transverse[c]", "riser_length"]
    assert group.priors[2].scale == 2.0 and group.priors[2].source.endswith(settled_terms.TAKEN_BACK)
    same = {p.name: p for p in group.priors}
    assert all(same[p.name] == p for p in demanding.chosen.priors)
    (begun,) = demanding.run.settled
    assert begun.begin[0].tolist() == [0.8, 0.3, 0.0, 70.0] and begun.begin[1] is PLACES and place.hyper is HYPER


def test_the_search_stands_where_no_term_is_far_off_zero(demanding):
    demanding.scores["transverse[c]"] = [(0.1, 0.1), (-0.79, 0.2)]
    assert demanding.again() is None
    demanding.scores["transverse[c]"] = None  # the record tells nothing of it
    assert demanding.again() is None and demanding.run.settled == []


def test_terms_come_back_to_a_search_only_and_only_where_flights_follow(demanding, monkeypatch):
    monkeypatch.setattr(settled_terms, "carried_over", lambda *given: None)
    assert demanding.again() is None
    demanding.run.job.study.structure.fit = "pool"
    monkeypatch.setattr(settled_terms.alternatives, "scores", None)  # not asked
    assert demanding.again() is None
