"""What the report says of knowledge from outside, of terms that are missing, and of what flights taught."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from bayeschute.report.figures.curve_figures import curve_figure
from bayeschute.report.page import _aerodynamics
from bayeschute.report.tables import curve_tables

ENTRY = {
    "name": "tunnel", "source": "1/10 scale", "kind": "curve", "target": "C_A", "use": "prior", "at": [0.1, 0.5], "unit": "rad",
    "values": [0.9, 0.5], "sd": [0.02, 0.02], "found": [0.91, 0.8], "found_sd": [0.01, 0.02], "z": [-0.4, -10.6],
    "chi_square": 112.0, "freedom": 2, "p_value": 4e-25, "verdict": "conflict", "in_model": True, "counted": False,
}  # fmt: skip
ASKED = {
    "kind": "transverse",
    "term": "e*alpha^4",
    "share": 0.42,
    "coefficient": 1.2,
    "z": 5.1,
    "p_value": 3e-7,
    "p_any": 6e-6,
}


def _with(results, **parts):
    return replace(results, summary={**results.summary, **parts})


def _words(table):
    return [[cell.text for cell in row] for row in table.rows]


def test_a_conflict_is_told_with_where_it_is_greatest(results):
    made = _with(results, knowledge=[ENTRY])
    (sentence,) = curve_tables.knowledge_sentences(made)
    assert "tunnel (1/10 scale) and the flights contradict each other about C_A" in sentence
    (row,) = _words(curve_tables.knowledge_table(made))
    assert row[:4] == ["tunnel", "C_A", "prior", "0.500 ± 0.020"] and row[-1] == "conflict"


def test_agreement_and_terms_that_the_model_lacks_are_told(results):
    fine = {**ENTRY, "verdict": "agreement", "p_value": 0.6, "in_model": False}
    said = " ".join(curve_tables.knowledge_sentences(_with(results, knowledge=[fine])))
    assert "has no term: it counts as zero" in said and "agrees with what the flights say of C_A (p = 0.60)" in said
    held = {**ENTRY, "verdict": "tension", "counted": True}
    assert "the conflict may be greater" in " ".join(curve_tables.knowledge_sentences(_with(results, knowledge=[held])))


def test_a_term_is_proposed_where_chance_would_hardly_make_it(results):
    said = curve_tables.proposal_sentence(_with(results, proposals=[ASKED]))
    assert "transverse[e*alpha^4] explains 42 % of the latent transverse force" in said
    chance = {**ASKED, "p_any": 0.8}
    assert curve_tables.proposal_sentence(_with(results, proposals=[chance])).endswith("more than chance would.")
    little = {**ASKED, "share": 0.003}
    said = curve_tables.proposal_sentence(_with(results, proposals=[little]))
    assert said.endswith(
        "none of the terms that the model lacks more than chance would, or by as much as 1 % of their variance."
    )
    assert len(_words(curve_tables.proposal_table(_with(results, proposals=[ASKED, chance])))) == 2


def test_a_run_without_any_of_it_says_nothing(results):
    assert curve_tables.knowledge_table(results) is None and curve_tables.proposal_table(results) is None
    assert curve_tables.proposal_sentence(results) == "" and curve_tables.taught_table(results) is None


def test_what_flights_taught_is_in_nats(results):
    rows = [{"name": "axial[1]", "prior_sd": 0.5, "sd": 0.1, "shift": -0.3, "gain": 1.17, "logarithmic": False}]
    made = curve_tables.taught_table(_with(results, taught={"flights": ["a", "b"], "parameters": rows, "joint": 1.5}))
    for coordinate, detail in (
        ("logarithm", "of its logarithm"),
        ("value", ""),
        ("at the apparent mass", "at the apparent mass"),
    ):
        rows[0]["coordinate"] = coordinate
        other = curve_tables.taught_table(_with(results, taught={"flights": ["a"], "parameters": rows, "joint": 1.5}))
        assert other.rows[0][0].small == detail
    assert _words(made)[0][0] == "axial[1]" and "a and b taught" in made.caption and "1.50 nats" in made.caption


def test_curves_are_drawn_with_prior_truth_and_what_others_know(results, tmp_path):
    at = np.linspace(0.0, 0.6, 20)
    rows = {
        "curve": "C_A",
        "symbol": "alpha",
        "unit": "rad",
        "at": at,
        "flown": (at > 0.1) & (at < 0.4),
        "truth": 0.9 - at**2,
    }
    for kind, wide in (("posterior", 0.05), ("prior", 0.3)):
        rows |= {f"{kind}_{q}": 0.9 - at**2 + wide * k for q, k in (("q05", -1), ("q50", 0), ("q95", 1))}
    made = replace(_with(results, knowledge=[ENTRY], curves={"words": {"C_A": "axial"}}), curves=pd.DataFrame(rows))
    figure = curve_figure(made.curves, [ENTRY], {"C_A": "axial"}, {})
    labels = {text.get_text() for text in figure.axes[0].get_legend().get_texts()}
    assert {"truth", "tunnel, 90 %", "prior, 90 %", "posterior, 90 %"} <= labels
    narrow = curve_figure(
        made.curves, [], {}, {"alpha": [at[1] + 1e-3, at[2] - 1e-3]}
    )  # between two points of the grid
    assert "range flown" in {text.get_text() for text in narrow.axes[0].get_legend().get_texts()}
    shown = _aerodynamics(made, tmp_path)
    assert "C_A" in shown["picture"].alt and (tmp_path / "curves.svg").exists() and shown["known"] is not None
