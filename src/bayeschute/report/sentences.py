"""Sentences of the report that are composed from results: requirement, prediction, checks, structure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bayeschute.calibration.label import has_level as label_has_level
from bayeschute.report.run_results import Results, entries, mappings
from bayeschute.report.wording import counted, is_number, listed, number, percent, probability, quantity, quantity_name

NO_LABEL = "not checked: the summary contains no label"


def has_level(results: Results) -> bool:
    """Whether the run states a level of trust for its intervals."""
    return label_has_level(label(results))


def label(results: Results) -> str:
    """The label of the run's intervals; a run without one is not checked."""
    return str(results.summary.get("label") or NO_LABEL)


def claim_sentences(results: Results) -> list[str]:
    """What a reader must know beside the label: its meaning, its limits, and what is not promised."""
    said = results.part("claim").get("sentences")
    return [str(text) for text in said] if isinstance(said, list) else []


def _unseen(results: Results, flight: str) -> bool:
    """Whether no part of a flight was fitted."""
    roles = entries(results.part("flights")).get(flight, {}).get("roles") or ()
    return bool(roles) and "identify" not in roles and "structure" not in roles


def _scored(results: Results) -> dict[str, dict[str, tuple[str, float]]]:
    """Flight -> quantity -> what was scored (truth first) and the share inside the 90 % band."""
    found: dict[str, dict[str, tuple[str, float]]] = {}
    for flight, quantities in entries(results.part("coverage")).items():
        for name, shares in entries(quantities).items():
            for kind in ("truth", "record"):
                if is_number(share := shares.get(kind)):
                    found.setdefault(flight, {}).setdefault(name, (kind, float(share)))
    return found


def prediction_sentence(results: Results) -> str:
    """Coverage of the 90 % bands, preferably on flights that were not fitted."""
    scored = _scored(results)
    words = {"truth": "true", "record": "recorded"}
    flights = [f for f in scored if _unseen(results, f)] or list(scored)
    if not flights:
        return "No flight has a true motion or a record against which its bands could be scored."
    if len(flights) == 1:
        flight = flights[0]
        names = [n for n in ("swing_angle", "descent_rate") if n in scored[flight]] or list(scored[flight])[:2]
        parts = [
            f"{percent(scored[flight][n][1])} of the {words[scored[flight][n][0]]} {quantity_name(n)}" for n in names
        ]
        where = "which was not fitted," if _unseen(results, flight) else "in the part that is scored,"
        return f"On {flight}, {where} the 90 % band contains {listed(parts)}."
    name = "descent_rate" if any("descent_rate" in scored[f] for f in flights) else next(iter(scored[flights[0]]))
    pairs = [scored[f][name] for f in flights if name in scored[f]]
    shares = sorted(share for _, share in pairs)
    kind = " or ".join(dict.fromkeys(words[kind] for kind, _ in pairs))
    return (
        f"Over {counted(len(shares), 'flight')} the 90 % bands contain {percent(shares[0])} to {percent(shares[-1])} "
        f"of the {kind} {quantity_name(name)} (median {percent(float(np.median(shares)))})."
    )


def requirement_limit(requirement: Mapping[str, Any]) -> str:
    """The limit of a requirement in words."""
    unit = str(requirement.get("unit") or "1")
    if is_number(requirement.get("at_most")):
        return f"at most {quantity(requirement['at_most'], unit)}"
    return f"at least {quantity(requirement.get('at_least'), unit)}"


def requirements(results: Results) -> list[Mapping[str, Any]]:
    """The requirements of the summary that are mappings."""
    return mappings(results.summary.get("requirements"))


def probability_met(requirement: Mapping[str, Any]) -> str:
    """Its probability, with ``=``; a bound where all simulated flights, or none, met it: more is not known of few."""
    share, low, high = (requirement.get(key) for key in ("probability_met", "simulation_low", "simulation_high"))
    if share == 1.0 and is_number(low):
        return f"> {probability(low)}"
    if share == 0.0 and is_number(high):
        return f"< {probability(high)}"
    return f"= {probability(share)}"


def risk_sentence(results: Results) -> str:
    """The requirement that is least likely to be met; without any, the predicted descent rate."""
    known = [r for r in requirements(results) if is_number(r.get("probability_met"))]
    if known:
        worst = min(known, key=lambda r: float(r["probability_met"]))
        where = f" on {worst['run']}" if worst.get("run") else ""
        text = (
            f"The requirement “{worst.get('name', 'unnamed')}”, {requirement_limit(worst)}, is met with probability "
            f"{probability_met(worst).removeprefix('= ')}{where}"
        )
        simulations = worst.get("simulations")
        if is_number(worst.get("simulation_low")) and is_number(simulations):
            text += (
                f" (Monte Carlo limits from {simulations:,.0f} simulated flights, 90 %: "
                f"{probability(worst['simulation_low'])} to {probability(worst.get('simulation_high'))})"
            )
        return text + "."
    for flight, bands in results.predictions.items():
        if "descent_rate" in bands:
            rate = (
                bands["descent_rate"].sel(quantile=[0.05, 0.95], method="nearest").transpose("quantile", "time").values
            )
            usable = np.flatnonzero(np.isfinite(rate).all(axis=0))
            if usable.size:
                low, high = (quantity(float(v), "m/s") for v in rate[:, usable[-1]])
                return f"At the end of {flight} the descent rate lies between {low} and {high} with 90 % probability."
    return "No requirement was stated and no descent rate was predicted."


def truth_inside(facts: Mapping[str, Any]) -> bool | None:
    """Whether the true value lies inside the 90 % interval; None where it is not known."""
    values = [facts.get(key) for key in ("q05", "truth", "q95")]
    if not all(is_number(v) for v in values):
        return None
    low, truth, high = (float(v) for v in values if v is not None)
    return low <= truth <= high


def checks_sentence(results: Results) -> str:
    """How many of a run's own checks passed or failed; those that were not judged are named apart.

    Its calibration is no check of the run: what replicates of others say of it is its level.
    """
    told = {name: check.get("passed") for name, check in entries(results.part("checks")).items()}
    checks = {name: passed for name, passed in told.items() if name != "calibration"}
    judged = {name: passed for name, passed in checks.items() if passed is not None}
    failed, left = [n for n in judged if not judged[n]], [n for n in checks if n not in judged]
    if not judged:
        text = "no check was judged" if checks else "no check was recorded"
    elif failed:
        text = f"{len(failed)} of {counted(len(judged), 'check')} failed ({listed([plain(n) for n in failed])})"
    else:
        text = "the one check passed" if len(judged) == 1 else f"all {len(judged)} checks passed"
    return f"{text}, not judged: {listed([plain(n) for n in left])}" if judged and left else text


def trust_sentence(results: Results) -> str:
    """Results of the checks, and coverage of known true parameter values."""
    text = checks_sentence(results)
    text = text[0].upper() + text[1:]
    inside = [truth_inside(facts) for facts in entries(results.part("parameters")).values()]
    known = [i for i in inside if i is not None]
    if known:
        text += f"; the 90 % intervals of {sum(known)} of {counted(len(known), 'parameter')} with a known true value "
        text += "contain it"
    return f"{text}."


def plain(name: str) -> str:
    """A key of the summary as words."""
    return name.replace("_", " ")


def key_sentences(results: Results) -> list[str]:
    """The three sentences of the header."""
    return [risk_sentence(results), prediction_sentence(results), trust_sentence(results)]


_NULL_MODELS = {
    "constant": "a constant alone",
    "constant force": "a force that is constant (weight over dynamic pressure, no aerodynamics)",
}


def fitted_terms(found: Mapping[str, Any]) -> str:
    """With which terms the simulated flight was fitted, and why with these.

    Args:
        found: `fitted_terms` of the summary.
    """
    begun = "The simulated flight was fitted with the following terms"
    if is_number(threshold := found.get("threshold")):
        return (
            f"{begun}. All candidates were fitted once; beyond a core, a term stays where the natural logarithm of its "
            f"Bayes factor is at least {number(threshold, 2)}. Parameters, curves and bands are of this model."
        )
    if found.get("how") == "selected":
        return f"{begun}: those that equation error selects below, and those that the fitted flight then asked for."
    return f"{begun}: all candidates."


def structure_sentences(facts: Mapping[str, Any]) -> list[str]:
    """Result of the structure selection for one coefficient."""
    selected = facts.get("selected") or []
    candidates = facts.get("candidates") or []
    text = f"{counted(len(selected), 'term')} selected" + (
        f" out of {counted(len(candidates), 'candidate')}" if candidates else ""
    )
    explained = facts.get("r2")
    if selected and is_number(explained):
        verb = "it explains" if len(selected) == 1 else "they explain"
        text += f"; {verb} {percent(explained, 1)} of the variation"
    if is_number(facts.get("snr")):
        text += f" (signal-to-noise ratio {number(facts['snr'], 2)})"
    found = [text + "."]
    null = facts.get("null_model")
    if isinstance(null, Mapping) and is_number(null.get("r2")):
        name = str(null.get("name", "a null model"))
        found.append(f"For comparison: {_NULL_MODELS.get(name, plain(name))} explains {percent(null['r2'])}.")
    collinearity = facts.get("collinearity")
    pair = collinearity.get("pair") if isinstance(collinearity, Mapping) else None
    if isinstance(collinearity, Mapping) and isinstance(pair, list | tuple) and any(pair):  # else the constant, and one
        between = f" ({' and '.join(map(str, pair))})"
        flagged = "they are nearly collinear" if collinearity.get("flagged") else "collinearity is no concern"
        found.append(
            f"Largest correlation between two selected terms: {number(collinearity['max_correlation'], 2)}{between}; "
            f"largest variance inflation factor: {number(collinearity.get('max_vif'), 2)}; {flagged}."
        )
    return found
