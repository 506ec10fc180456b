"""Content of the structure section of the report: vector form, polar form, and simulation study with known terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from matplotlib.figure import Figure

from bayeschute.report import sentences
from bayeschute.report.figures import inference_figures
from bayeschute.report.run_results import Results, entries
from bayeschute.report.tables import structure_tables, summary_tables
from bayeschute.report.wording import listed

Draw = Callable[[Figure, str, str, str], Any]  # figure, name of its file, words instead of it, caption


def _part(name: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "name": name,
        "sentences": sentences.structure_sentences(facts),
        "selected": summary_tables.selected_table(facts),
        "stability": structure_tables.stability_table(facts),
        "structures": structure_tables.structures_table(facts),
        "prediction": structure_tables.prediction_table(facts),
        "ceiling": summary_tables.ceiling_table(facts),
        "ranking": summary_tables.ranking_table(facts),
    }


def _synthetic(results: Results) -> dict[str, Any] | None:
    found = results.structure.get("synthetic")
    if not isinstance(found, Mapping) or not isinstance(found.get("coefficients"), Mapping):
        return None
    parts = [
        {
            "name": name,
            "sentences": structure_tables.synthetic_sentences(name, facts),
            "known": structure_tables.known_table(facts),
            "false": structure_tables.false_table(facts),
            "ranking": summary_tables.ranking_table(facts),
        }
        for name, facts in entries(found["coefficients"]).items()
    ]
    said = {key: found.get(key) for key in ("source", "reading", "flight", "canopy", "time_constant", "replicates")}
    return said | {"targets": structure_tables.target_table(found), "parts": parts}


def structure_view(results: Results, draw: Draw) -> dict[str, Any]:
    """Content of the structure section.

    Args:
        results: The run.
        draw: Saves a figure and returns what the template shows.
    """
    coefficients = entries(results.structure.get("coefficients"))
    pictures = []
    ranked = {n: f for n, f in coefficients.items() if f.get("ranking")}
    if ranked:
        kept = [f"{n}: {len(f.get('selected') or [])} terms selected" for n, f in ranked.items()]
        caption = (
            "Terms are added in the order of their contribution. The fit error always decreases; the predicted squared "
            "error (PSE) adds a penalty for every term, and its minimum selects the number of terms."
        )
        alt = f"Fit error and predicted error against the number of terms. {listed(kept)}."
        pictures.append(draw(inference_figures.pse_figure(ranked), "structure-pse", alt, caption))
    fitted = results.part("fitted_terms")
    return {
        "fitted": fitted
        and {"text": sentences.fitted_terms(fitted), "table": summary_tables.fitted_terms_table(fitted)},
        "parts": [_part(name, facts) for name, facts in coefficients.items()],
        "polar": [_part(name, facts) for name, facts in entries(results.structure.get("polar")).items()],
        "synthetic": _synthetic(results),
        "pictures": pictures,
        "sufficiency": results.structure.get("sufficiency") or [],
    }
