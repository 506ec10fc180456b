"""Identifiability in the report: sentences and tables."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest

from bayeschute.report.run_results import identifiability_of
from bayeschute.report.tables import identifiability_tables as page
from bayeschute.report.wording import MISSING


def _changed(results, **parameters):
    """The run with other facts of some parameters."""
    summary = copy.deepcopy(dict(results.summary))
    for name, facts in parameters.items():
        summary["identifiability"]["all"]["parameters"].setdefault(name, {}).update(facts)
    return _with(results, summary)


def _with(results, summary):
    """The run with another summary, and what is read of it."""
    return replace(results, summary=summary, identifiability=identifiability_of(summary, []))


def _fit(parameters, **rest):
    return {"parameters": parameters, **rest}


def test_sentences_name_what_the_data_determine_and_what_not(results):
    riser = dict.fromkeys(("riser_stiffness", "riser_damping"), 0.02)
    made = _changed(results, **{n: {"contraction": c} for n, c in riser.items()}, riser_length={"contraction": 0.3})
    text = " ".join(page.identifiability_sentences(made))
    assert "The data determine 6 of 9 parameters" in text
    assert "They determine riser_length in part." in text
    assert "hardly any information about riser_stiffness and riser_damping: the posterior is the prior" in text
    assert "The least determined direction is riser_damping, nearly alone: the data remove 1.0 % of the prior v" in text
    assert "several parameters the least determined is 0.81 axial[1] − 0.59 axial[alpha^2] (96.8 %)" in text
    assert "best determined direction is transverse[rate], nearly alone: 1.0 % of the prior standard deviation" in text
    assert "transverse[rate] (21 % of its variance; mostly “wind, horizontal, sd”, correlation 0.40)" in text
    assert "Of 2 noise parameters the data hardly determine “slow wind, vertical, time constant”" in text
    assert "determined mostly by the prior" not in text  # of these two all was said
    assert "Prior and data both determine riser_length, and they agree." in text
    assert "The posterior of the other 6 is insensitive to the prior." in text
    assert "the profile likelihood does not bound riser_stiffness and riser_damping" in text
    assert "riser_length between 71.12 m (233.3 ft) and 71.48 m (234.5 ft)" in text


def test_a_parameter_has_one_diagnosis_in_sentences_and_table(results):
    """As of a wide posterior of a stiffness, which power scaling alone calls a conflict or an agreement."""
    felt = {"prior_sensitivity": 0.2, "likelihood_sensitivity": 0.1, "shift": 0.3}
    made = _changed(
        results,
        riser_stiffness=felt | {"contraction": -0.23},
        riser_damping=felt | {"contraction": 0.3},
        riser_length={"prior_sensitivity": 0.2, "likelihood_sensitivity": 0.0, "shift": 0.3, "contraction": 0.83},
    )
    text = " ".join(page.identifiability_sentences(made))
    assert "about riser_stiffness: the posterior is the prior. That of riser_stiffness is wider than the prior" in text
    assert "Prior and data both determine riser_damping, and they agree." in text
    assert "The data determine riser_length, but not so well that the prior is not felt." in text
    assert "mostly by the prior" not in text and "conflict" not in text
    diagnoses = {row[0].text: row[-1].text for row in page.identifiability_table(made).rows}
    assert [diagnoses[f"riser_{name}"] for name in ("stiffness", "damping", "length")] == [
        page.UNTOLD,
        page.AGREE,
        page.FELT,
    ]
    moved = _changed(results, riser_stiffness=felt | {"contraction": 0.02, "shift": 1.2})
    assert "may be in conflict for riser_stiffness" in " ".join(page.identifiability_sentences(moved))


def test_a_mean_that_moved_far_is_a_conflict(results):
    made = _changed(results, riser_length={"shift": -1.4}, riser_damping={"contraction": 0.2})
    text = " ".join(page.identifiability_sentences(made))
    assert "may be in conflict for riser_length (shifted by −1.4 prior standard deviations)" in text
    assert "agree" not in text
    diagnoses = {row[0].text: row[-1].text for row in page.identifiability_table(made).rows}
    assert diagnoses["riser_length"] == "possible conflict of prior and data"
    assert diagnoses["riser_damping"] == "determined by the prior"
    assert diagnoses["axial[1]"] == "insensitive to the prior"


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"low": 0.07, "high": None, "unit": "rad"}, "length only above 4.011 deg"),
        ({"low": None, "high": 2.0, "unit": "1"}, "puts length only below 2.000."),
    ],
)
def test_an_interval_open_to_one_side(results, ends, words):
    facts = {"length": {"prior_sensitivity": 0.2, "likelihood_interval": {"level": 0.9, **ends}}}
    made = _with(results, {"identifiability": {"all": _fit(facts)}})
    assert words in " ".join(page.identifiability_sentences(made))


def test_nothing_is_confounded_and_no_posterior_is_sensitive(results):
    facts = {"a": {"noise_share": 0.01, "prior_sensitivity": 0.0}, "b": {"noise_share": 0.03, "prior_sensitivity": 0.0}}
    made = _with(results, {"identifiability": {"all": _fit(facts)}})
    text = " ".join(page.identifiability_sentences(made))
    assert "at most 3.0 % of a posterior variance (b)" in text
    assert "No posterior is sensitive to the priors" in text


def test_many_fits_are_counted_not_listed(results):
    fits = {
        f"s{i}": _fit(
            {f"drag[s{i}]": {"contraction": 0.01, "noise_share": 0.2, "noise_partner": "wind, sd"}},
            noise={"wind, sd": 0.05},
        )
        for i in range(9)
    }
    summary = {"identifiability": fits}
    text = " ".join(page.identifiability_sentences(_with(results, summary)))
    assert text.count("drag[") == 2 * page.MOST and "5 others (see the table)" in text
    assert "“wind, sd” (in 9 of 9 fits)" in text
    assert len(page.identifiability_table(_with(results, summary)).rows) == 9
    assert page.direction_table(_with(results, summary)) is None


def test_a_sandwich_fit_has_contractions_only(results):
    directions = [{"weights": {"a": 1.0}, "information": 3.0, "contraction": 0.75, "words": "1.00 a"}]
    facts = {"a": {"contraction": 0.75, "shift": 0.4}}
    summary = {"identifiability": {"all": _fit(facts, directions=directions, noise={})}}
    made = _with(results, summary)
    assert page.identifiability_sentences(made) == [
        "The data determine 1 of 1 parameter: they remove more than half of the prior variance."
    ]
    (row,) = page.identifiability_table(made).rows
    assert [cell.text for cell in row] == ["a", "75.0 %", "0.40", *[MISSING] * 5]


def test_shares_are_never_rounded_up_to_all(results):
    made = _changed(results, **{"axial[1]": {"contraction": 0.99996}})
    shares = {row[0].text: row[1].text for row in page.identifiability_table(made).rows}
    assert shares["axial[1]"] == "> 99.9 %"


def test_only_the_least_determined_directions_are_shown(results):
    many = [{"weights": {}, "contraction": 0.1 * i, "information": 1.0, "words": f"1.00 p{i}"} for i in range(8)]
    summary = {"identifiability": {"all": _fit({}, directions=many)}}
    table = page.direction_table(_with(results, summary))
    assert [row[0].text for row in table.rows] == [f"1.00 p{i}" for i in range(page.LEAST)]
    assert [row[2].text for row in table.rows[:2]] == ["1.0", "0.95"]


def test_without_facts_nothing_is_said(results):
    for part in ({}, {"identifiability": 3}, {"identifiability": {"all": 3}}):
        empty = _with(results, part)
        assert page.identifiability_sentences(empty) == []
        assert page.identifiability_table(empty) is None and page.direction_table(empty) is None


def test_results_of_another_form_are_named():
    absent = []
    assert identifiability_of({"identifiability": {"all": {"parameters": {"a": {"shift": "far"}}}}}, absent) == {}
    assert len(absent) == 1 and "identifiability.all.parameters.a.shift" in absent[0] and "not shown" in absent[0]


def test_a_posterior_as_wide_as_its_prior_and_elsewhere_is_not_called_the_prior(results):
    """A coefficient at the edge: moved by 1.4 prior standard deviations, and no better known."""
    edge = {"prior_sensitivity": 0.2, "likelihood_sensitivity": 0.1, "shift": -1.4, "contraction": -0.05}
    made = _changed(results, riser_stiffness=edge, riser_damping={"contraction": 0.02, "shift": 0.1})
    text = " ".join(page.identifiability_sentences(made))
    assert "hardly any information about riser_damping: the posterior is the prior." in text
    assert "They move riser_stiffness away from the prior and leave it no narrower." in text
    assert "Prior and data may be in conflict for riser_stiffness (shifted by −1.4 prior" in text
