"""First screen of the report: is the limit met, how sure, on what evidence, and what would change it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bayeschute.calibration.label import Level
from bayeschute.calibration.promises import shown
from bayeschute.report import sentences
from bayeschute.report.run_results import Results, entries
from bayeschute.report.wording import counted, is_number, listed, percent, probability, quantity, quantity_name

_CHANGES = {
    "parameter": "a further drop, which teaches the coefficients",
    "wind": "wind measured closer to the canopies, or calmer air",
    "initial state": "a better known start of the flight",
    "canopy force": "terms that explain more of the canopies' forces",
}
"""What makes a source of variance smaller."""


def answers(results: Results) -> list[tuple[str, str, str]]:
    """Question, short answer and a line about it, of the requirement that is least likely to be met.

    Args:
        results: Of a run.

    Returns:
        Empty where no requirement has a probability: the sentences below say what there is.
    """
    known = [r for r in sentences.requirements(results) if is_number(r.get("probability_met"))]
    if not known:
        return []
    worst = min(known, key=lambda r: float(r["probability_met"]))
    return [_met(results, worst, known), _sure(worst), _evidence(results, worst), _change(results, worst)]


def _level(results: Results) -> str:
    return str(results.part("claim").get("level") or Level.NOT_CHECKED.words)


def _met(results: Results, worst: Mapping[str, Any], known: list[Mapping[str, Any]]) -> tuple[str, str, str]:
    """Whether the limit is met, by the probability at which a reader would say so; whose word it is."""
    share = float(worst["probability_met"])
    said = "Very likely" if share >= 0.95 else "Likely" if share >= 0.8 else "Not likely" if share <= 0.2 else "Open"
    about = f"{worst.get('name', 'unnamed')}, {sentences.requirement_limit(worst)}"
    others = f"; the least likely of {counted(len(known), 'requirement')}" if len(known) > 1 else ""
    if results.part("claim").get("contradicted"):
        said += ", says a model that its own data contradict"
    elif _level(results) == Level.NOT_CHECKED.words:
        said += ", says a model that is not checked"
    return "Is the limit met?", said, about + others


def _sure(worst: Mapping[str, Any]) -> tuple[str, str, str]:
    """The probability, its Monte Carlo error, and the margin."""
    said = f"P {sentences.probability_met(worst)}"
    unit, parts = str(worst.get("unit") or "1"), []
    if is_number(worst.get("failed")) and worst["failed"] > 0:
        lost = counted(int(worst["failed"]), "simulation")
        parts.append(f"{lost} of {worst.get('draws')} failed and count as if the limit were not met")
    if is_number(worst.get("simulation_low")) and is_number(worst.get("simulation_high")):
        low, high = probability(worst["simulation_low"]), probability(worst["simulation_high"])
        parts.append(f"90 % Monte Carlo limits {low} to {high} (finite number of simulated flights)")
    if is_number(worst.get("q05")) and is_number(worst.get("q95")):
        parts.append(f"predicted 90 % interval {quantity(worst['q05'], unit)} to {quantity(worst['q95'], unit)}")
    return "How sure?", said, "; ".join(parts)


def _evidence(results: Results, worst: Mapping[str, Any]) -> tuple[str, str, str]:
    """Calibration, checks, and flights that the estimate rests on; whether it speaks for the requirement's quantity."""
    flights = entries(results.part("flights"))
    fitted = [name for name, facts in flights.items() if "identify" in (facts.get("roles") or ())]
    claim = results.part("claim")
    against, level = claim.get("contradicted"), _level(results)
    said = "Contradicted by its own data" if against else level.capitalize()
    about = f"{counted(len(fitted), 'flight')} fitted ({listed(fitted)})" if fitted else "no flight was fitted"
    about = f"{about}; {sentences.checks_sentence(results)}"
    name = shown(f"predict/{worst.get('statistic')} {worst.get('quantity')}")
    left = next((one for one in map(str, claim.get("not_promised") or ()) if one.partition(" (")[0] == name), "")
    if left and not against and level != Level.NOT_CHECKED.words:
        said += ", which does not promise this quantity"
        about += f"; not promised: {left}"
    return "On what evidence?", said, about


def _change(results: Results, worst: Mapping[str, Any]) -> tuple[str, str, str]:
    """The source that most of the prediction's variance comes from."""
    flight, name = str(worst.get("run")), str(worst.get("quantity"))
    bands = results.predictions.get(flight)
    question = "What would change it?"
    if bands is None or "variance_share" not in bands or name not in bands["variance_share"]["quantity"].values:
        return question, "Not known", "the run has no shares of variance for this quantity"
    shares = bands["variance_share"].sel(quantity=name).dropna("source")
    if not shares.sizes["source"]:
        return question, "Not known", "the run has no shares of variance for this quantity"
    source = str(shares["source"].values[int(np.argmax(shares.values))])
    remedy = _CHANGES.get(source, f"knowing the {source} better")
    about = f"{percent(float(shares.max()))} of the variance of the {quantity_name(name)} comes from: {source}"
    return question, remedy[0].upper() + remedy[1:], about
