"""Content of the structure section: what is drawn, and parts that are damaged."""

from __future__ import annotations

from pathlib import Path

from bayeschute.report import structure_view as module
from bayeschute.report.run_results import Results
from bayeschute.report.structure_view import structure_view


def results(structure):
    return Results(Path(), {}, structure, {}, {}, {}, {}, {}, ())


def test_only_coefficients_with_a_ranking_are_drawn_and_all_have_a_part(monkeypatch):
    monkeypatch.setattr(module, "_part", lambda name, facts: name)
    monkeypatch.setattr(module.inference_figures, "pse_figure", lambda ranked: list(ranked))
    ranked = {"ranking": [{"mse": 1.0, "pse": 2.0}], "selected": [{}, {}]}
    found = {
        "coefficients": {"axial": ranked, "transverse": {"ranking": []}, "damaged": 3},
        "polar": {"C_A": ranked},
        "sufficiency": ["So far."],
        "synthetic": {"coefficients": None},
    }
    drawn = []
    view = structure_view(results(found), lambda *given: drawn.append(given) or "picture")
    assert view["parts"] == ["axial", "transverse"] and view["polar"] == ["C_A"] and view["pictures"] == ["picture"]
    ((figure, name, alt, _),) = drawn
    assert figure == ["axial"] and name == "structure-pse" and alt.endswith("axial: 2 terms selected.")
    assert view["synthetic"] is None and view["sufficiency"] == ["So far."]


def test_a_run_without_a_structure_draws_nothing():
    view = structure_view(results({}), lambda *given: 1 / 0)
    assert view == {"fitted": {}, "parts": [], "polar": [], "synthetic": None, "pictures": [], "sufficiency": []}
