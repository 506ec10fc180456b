"""What the report says of what the record tells."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest

from bayeschute.posterior.assess import identifiability
from bayeschute.report.tables import identifiability_tables as page
from bayeschute.report.wording import MISSING


def _changed(results, **parameters):
    """The run with other facts of some parameters, and a contraction for each."""
    summary = copy.deepcopy(dict(results.summary))
    for name, facts in parameters.items():
        contraction = facts.pop("contraction", None)
        summary["identifiability"]["all"]["parameters"].setdefault(name, {}).update(facts)
        if contraction is not None:
            summary["parameters"].setdefault(name, {})["contraction"] = contraction
    return replace(results, summary=summary)


def _fit(parameters, **rest):
    return {"parameters": parameters, **rest}


def test_the_bound_is_that_of_the_inference():
    assert page.FELT == identifiability.FELT


def test_sentences_name_what_is_told_and_what_is_not(results):
    riser = dict.fromkeys(("riser_stiffness", "riser_damping"), 0.02)
    made = _changed(results, **{n: {"contraction": c} for n, c in riser.items()}, riser_length={"contraction": 0.3})
    text = " ".join(page.told_sentences(made))
    assert "Of 9 parameters the record tells 6" in text
    assert "It tells riser_length in part." in text
    assert "hardly anything about riser_stiffness and riser_damping: what stands there is the prior" in text
    assert "Least told is riser_damping, nearly alone: the record takes away 1.0 % of the prior's variance" in text
    assert "Of mixtures the least told is 0.81 axial[1] − 0.59 axial[alpha^2] (96.8 %)" in text
    assert "Best told is transverse[rate], nearly alone: 1.0 % of the prior's standard deviation is left" in text
    assert "widens transverse[rate] (21 % of its variance; foremost “wind, horizontal, sd”, correlation 0.40)" in text
    assert "Of 2 noise parameters the record hardly tells “slow wind, vertical, time constant”" in text
    assert "riser_stiffness and riser_damping hang mostly on the prior." in text
    assert "Prior and record both shape riser_length, and they agree." in text
    assert "For the other 6 the prior hardly matters." in text
    assert "the record would set no bounds to riser_stiffness and riser_damping" in text
    assert "riser_length between 71.12 and 71.48 m" in text


def test_a_mean_that_moved_far_is_a_disagreement(results):
    made = _changed(results, riser_length={"shift": -1.4})
    text = " ".join(page.told_sentences(made))
    assert "may pull apart for riser_length (moved by −1.4 standard deviations of its prior)" in text
    assert "agree" not in text
    readings = {row[0].text: row[-1].text for row in page.told_table(made).rows}
    assert readings["riser_length"] == "prior and record may disagree"
    assert readings["riser_damping"] == "mostly the prior"
    assert readings["axial[1]"] == "the prior hardly matters"


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"low": 0.07, "high": None, "unit": "rad"}, "length only above 4.011 deg"),
        ({"low": None, "high": 2.0, "unit": "1"}, "length only below 2.000 ("),
    ],
)
def test_an_interval_open_to_one_side(results, ends, words):
    facts = {"length": {"prior_sensitivity": 0.2, "likelihood_interval": ends}}
    made = replace(results, summary={"identifiability": {"all": _fit(facts)}})
    assert words in " ".join(page.told_sentences(made))


def test_nothing_is_confounded_and_no_prior_is_felt(results):
    facts = {"a": {"noise_share": 0.01, "prior_sensitivity": 0.0}, "b": {"noise_share": 0.03, "prior_sensitivity": 0.0}}
    made = replace(results, summary={"identifiability": {"all": _fit(facts)}})
    text = " ".join(page.told_sentences(made))
    assert "at most 3.0 % of a variance (b)" in text
    assert "No parameter feels its prior" in text


def test_many_fits_are_counted_not_listed(results):
    fits = {
        f"s{i}": _fit({f"drag[s{i}]": {"noise_share": 0.2, "noise_partner": "wind, sd"}}, noise={"wind, sd": 0.05})
        for i in range(9)
    }
    summary = {"identifiability": fits, "parameters": {f"drag[s{i}]": {"contraction": 0.01} for i in range(9)}}
    text = " ".join(page.told_sentences(replace(results, summary=summary)))
    assert text.count("drag[") == 2 * page.MOST and "5 others (see the table)" in text
    assert "“wind, sd” (in 9 of 9 fits)" in text
    assert len(page.told_table(replace(results, summary=summary)).rows) == 9
    assert page.direction_table(replace(results, summary=summary)) is None


def test_a_sandwich_tells_what_it_can(results):
    directions = [{"weights": {"a": 1.0}, "information": 3.0, "contraction": 0.75, "words": "1.00 a"}]
    summary = {
        "identifiability": {"all": _fit({"a": {"shift": 0.4}}, directions=directions, noise={})},
        "parameters": {"a": {"contraction": 0.75}},
    }
    made = replace(results, summary=summary)
    assert page.told_sentences(made) == [
        "Of 1 parameter the record tells 1: it takes away more than half of the variance that the prior left."
    ]
    (row,) = page.told_table(made).rows
    assert [cell.text for cell in row] == ["a", "75.0 %", "0.40", *[MISSING] * 5]


def test_shares_are_never_rounded_up_to_all(results):
    made = _changed(results, **{"axial[1]": {"contraction": 0.99996}})
    told = {row[0].text: row[1].text for row in page.told_table(made).rows}
    assert told["axial[1]"] == "> 99.9 %"


def test_directions_are_cut_at_the_least_told(results):
    many = [{"contraction": 0.1 * i, "information": 1.0, "words": f"1.00 p{i}"} for i in range(8)]
    summary = {"identifiability": {"all": _fit({}, directions=many)}}
    table = page.direction_table(replace(results, summary=summary))
    assert [row[0].text for row in table.rows] == [f"1.00 p{i}" for i in range(page.LEAST)]
    assert [row[2].text for row in table.rows[:2]] == ["1.0", "0.95"]


def test_without_facts_nothing_is_said(results):
    for part in ({}, {"identifiability": 3}, {"identifiability": {"all": 3}}):
        empty = replace(results, summary=part)
        assert page.told_sentences(empty) == []
        assert page.told_table(empty) is None and page.direction_table(empty) is None
