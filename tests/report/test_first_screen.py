from __future__ import annotations

import json
import re
from dataclasses import replace
from urllib.parse import unquote

import numpy as np
import pytest
from jinja2 import Environment

from bayeschute.report import first_screen, sentences
from bayeschute.report.figures.canvas import data_uri, lighter
from bayeschute.report.page import build_report
from bayeschute.report.run_results import read_results


@pytest.fixture
def results(make_run, tmp_path):
    return read_results(make_run(tmp_path))


def _with(results, **changes):
    requirement = results.summary["requirements"][0] | changes
    return replace(results, summary={**results.summary, "requirements": [requirement]})


def test_four_questions_are_answered_from_the_results(results):
    asked = {question: (answer, about) for question, answer, about in first_screen.answers(results)}
    assert list(asked) == ["Is the limit met?", "How sure?", "On what evidence?", "What would change it?"]
    requirement = results.summary["requirements"][0]
    assert requirement["name"] in asked["Is the limit met?"][1] and "10.1 m/s" in asked["Is the limit met?"][1]
    assert asked["How sure?"][0].startswith("P = 0.9")
    assert asked["On what evidence?"][0] == "Not checked"


@pytest.mark.parametrize(
    ("share", "said"), [(0.99, "Very likely"), (0.9, "Likely"), (0.5, "Open"), (0.1, "Not likely")]
)
def test_words_follow_the_probability(results, share, said):
    (first, *_) = first_screen.answers(_with(results, probability_met=share))
    assert first[1] == f"{said}, says a model that is not checked"
    checked = {"claim": {"level": "self-consistent"}}
    told = _with(results, probability_met=share)
    (first, *_) = first_screen.answers(replace(told, summary={**told.summary, **checked}))
    assert first[1] == said
    against = {"claim": {"level": "not checked", "contradicted": ["the record is not one that the model makes"]}}
    (first, *_) = first_screen.answers(replace(told, summary={**told.summary, **against}))
    assert first[1] == f"{said}, says a model that its own data contradict"
    evidence = {
        question: said for question, said, _ in first_screen.answers(replace(told, summary={**told.summary, **against}))
    }
    assert evidence["On what evidence?"] == "Contradicted by its own data"


@pytest.mark.parametrize(
    ("share", "low", "high", "said"),
    [(1.0, 0.993, 1.0, "> 0.993"), (0.0, 0.0, 0.007, "< 0.007"), (0.5, 0.4, 0.6, "= 0.50"), (1.0, None, None, "= 1.000")],
)  # fmt: skip
def test_of_few_simulations_a_bound_is_told(results, share, low, high, said):
    """All of them, or none, met the limit: that is no certainty."""
    given = _with(results, probability_met=share, simulation_low=low, simulation_high=high)
    (answer,) = [told for question, told, _ in first_screen.answers(given) if question == "How sure?"]
    assert answer == f"P {said}"
    assert f"is met with probability {said.removeprefix('= ')}" in sentences.risk_sentence(given)


def test_simulations_that_failed_are_told_beside_the_probability(results):
    (_, said, about), *_ = [one for one in first_screen.answers(_with(results, failed=3, draws=64)) if "sure" in one[0]]
    assert about.startswith("3 simulations of 64 failed and count as if the limit were not met; ")
    (_, _, about), *_ = [one for one in first_screen.answers(_with(results, failed=0)) if "sure" in one[0]]
    assert "failed" not in about


@pytest.mark.parametrize(
    ("left", "promised"),
    [
        (["mean descent rate of unseen flights (85 ± 4 %, undecided)", "landings"], True),
        (["mean sea level descent rate of unseen flights (85 ± 4 %, undecided)"], False),
        (["mean sea level descent rate of unseen flights"], False),
    ],
)
def test_a_quantity_that_is_not_promised_is_said_to_be(results, left, promised):
    given = _with(results, statistic="mean", quantity="sea_level_descent_rate")
    claim = {"claim": {"level": "self-consistent", "not_promised": left}}
    made = first_screen.answers(replace(given, summary={**given.summary, **claim}))
    (told,) = [(said, about) for question, said, about in made if question == "On what evidence?"]
    assert told[0] == "Self-consistent" + ("" if promised else ", which does not promise this quantity")
    assert told[1].endswith(f"; not promised: {left[0]}") != promised


@pytest.mark.parametrize(
    ("checks", "said"),
    [
        ({}, "no check was recorded"),
        ({"mode": None}, "no check was judged"),
        ({"rhat": True}, "the one check passed"),
        ({"rhat": True, "mode": True, "calibration": None}, "all 2 checks passed"),
        ({"rhat": True, "mode": True, "calibration": False}, "all 2 checks passed"),
        ({"rhat": True, "draws_distance": False, "mode": None, "calibration": False},
         "1 of 2 checks failed (draws distance), not judged: mode"),
    ],
)  # fmt: skip
def test_checks_are_counted_alike_everywhere_those_not_judged_apart(results, checks, said):
    """As the shell does, which leaves the calibration to the run's level."""
    told = {"checks": {name: {"passed": passed} for name, passed in checks.items()}}
    made = replace(results, summary={**results.summary, **told})
    (evidence,) = [about for question, _, about in first_screen.answers(made) if question == "On what evidence?"]
    assert evidence.endswith(f"; {said}")
    assert sentences.trust_sentence(made).lower().startswith(said)


def test_without_a_probability_nothing_is_answered(results):
    assert first_screen.answers(_with(results, probability_met=None)) == []


def test_the_largest_share_of_variance_is_what_would_change_it(results):
    requirement = results.summary["requirements"][0]
    bands = results.predictions[requirement["run"]]
    name = str(bands["variance_share"]["quantity"].values[0])
    shares = bands["variance_share"].sel(quantity=name)
    (*_, last) = first_screen.answers(_with(results, quantity=name))
    assert str(shares["source"].values[int(np.argmax(shares.values))]) in last[2]
    (*_, last) = first_screen.answers(_with(results, quantity="horizontal_speed"))
    assert last[1] == "Not known"


def test_every_table_that_scrolls_is_reached_by_the_keyboard_and_named(run_dir):
    text = (run_dir / "report.html").read_text(encoding="utf-8")
    tables = re.findall(r'<div class="scroll"([^>]*)>', text)
    assert len(tables) > 8 and text.count("<table") == len(tables)
    for attributes in tables:
        assert 'tabindex="0"' in attributes and 'role="region"' in attributes
        assert re.search(r'aria-label="[^"]{5,}"', attributes)


def test_contents_are_shown_in_print_and_on_narrow_screens_and_the_dark_has_colours(bare_text):
    assert "nav { display: none" not in bare_text
    assert "prefers-color-scheme: dark" in bare_text
    light, dark = (set(re.findall(r"(--[a-z-]+):", one)) for one in re.findall(r":root \{([^}]*)\}", bare_text))
    assert light == dark
    assert set(re.findall(r"var\((--[a-z-]+)\)", bare_text)) <= light


@pytest.fixture
def bare_text(tmp_path):
    (tmp_path / "summary.json").write_text(json.dumps({}))
    return build_report(tmp_path).read_text(encoding="utf-8")


def test_coordinates_are_rounded_and_scales_are_not():
    svg = '<g transform="scale(0.015625)"><path id="a" d="M 1.234567 2.5 \nL -0.004321 10" style="stroke-width: 0.123456"/>'
    kept = '<g transform="scale(0.015625)"><path id="a" d="M1.23 2.5l-1.23 7.5" style="stroke-width: 0.123456"/>'
    assert lighter(svg) == kept
    curve = '<path d="M 1 2 \nQ 3.004 4 5 6.129 \nz"/>'
    assert lighter(curve) == '<path d="M 1 2 Q 3.00 4 5 6.13 z"/>'


def test_lines_told_from_point_to_point_do_not_drift():
    """Points of thousands of steps, summed up again, are those that were drawn, and a part that is closed ends there."""
    points = 500.0 + 300.0 * np.random.default_rng(3).standard_normal((2, 3000, 2))
    parts = [" \n".join(f"{'ML'[i > 0]} {x:.6f} {y:.6f}" for i, (x, y) in enumerate(part)) for part in points]
    path = lighter(f'<path d="{parts[0]} \nz \n{parts[1]} "/>')
    found = re.findall(r"([Ml]| )(-?[\d.]+) (-?[\d.]+)|(z)", path.split('"')[1])
    at, seen = np.zeros(2), []
    for letter, x, y, closed in found:
        if not closed:
            at = np.array([float(x), float(y)]) + (0.0 if letter == "M" else at)
            seen.append(at)
    assert [i for i, one in enumerate(found) if one[3]] == [3000]
    np.testing.assert_allclose(seen, points.reshape(-1, 2), atol=0.00501)


def test_a_picture_can_neither_end_its_attribute_nor_lose_a_character():
    svg = '<svg id="a">\n <!-- it\'s 5 % of <b> & "c" -->\n <use href="#a"/>\n</svg>'
    page = Environment(autoescape=True).from_string('<img src="{{ uri }}">').render(uri=data_uri(svg))
    uri = re.fullmatch('<img src="([^"]*)">', page)[1]
    assert "&" not in uri and "#" not in uri
    shown = unquote(uri.removeprefix("data:image/svg+xml,")).replace("'", '"').replace("&apos;", "'")
    assert shown.split() == svg.split()
