"""Practical identifiability: contraction, noise uncertainty, prior sensitivity and profile likelihood in words.

Sentences first, then the tables they come from. Contraction: 1 - posterior variance / prior variance. Sensitivity:
power scaling of prior and likelihood (Kallioinen et al. 2023). Profile likelihood: Raue et al. (2009).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.report.run_results import Results
from bayeschute.report.sentences import plain
from bayeschute.report.tables.summary_tables import Cell, Table, cells, columns_of, mappings
from bayeschute.report.wording import MISSING, counted, is_number, listed, number, percent, shown_unit

INFORMED = 0.5  # contraction from which a parameter counts as determined by the data
UNINFORMED = 0.1  # contraction below which the posterior counts as the prior
NOISE_MATTERS = 0.05  # share of a parameter's variance due to uncertain noise parameters, from which it is named
SENSITIVE = 0.05  # power-scaling sensitivity that matters, as in `posterior.assess.identifiability`
CONFLICT = 1.0  # shift of the mean in prior standard deviations that, with both sensitivities, may be a conflict
LEAST = 5  # combinations shown
INSENSITIVE, PRIOR_ONLY = "insensitive to the prior", "determined by the prior"
AGREE, MAY_CONFLICT = "prior and data both matter, and agree", "possible conflict of prior and data"
MOST = 4  # names in a sentence


def fits(results: Results) -> dict[str, Mapping[str, Any]]:
    """Identifiability results by fit."""
    return {str(k): v for k, v in results.part("identifiability").items() if isinstance(v, Mapping)}


def _parameters(results: Results) -> dict[str, Mapping[str, Any]]:
    """Results by parameter, over all fits."""
    found = (fit.get("parameters") for fit in fits(results).values())
    return {
        str(name): facts
        for part in found
        if isinstance(part, Mapping)
        for name, facts in part.items()
        if isinstance(facts, Mapping)
    }


def _contractions(results: Results) -> dict[str, float]:
    """Contraction of every parameter of the fits [1]."""
    summary = results.part("parameters")
    entries = {name: summary.get(name) for name in _parameters(results)}
    shares = {name: facts.get("contraction") for name, facts in entries.items() if isinstance(facts, Mapping)}
    return {name: float(share) for name, share in shares.items() if is_number(share)}


def _some(items: list[str]) -> str:
    """Items as in a sentence; only the first are named where they are many."""
    rest = len(items) - MOST
    return listed(items if rest <= 1 else [*items[:MOST], f"{rest} others (see the table)"])


def _share(value: Any, digits: int = 1) -> str:
    """A share in percent, never rounded up to all."""
    return "> 99.9 %" if is_number(value) and 0.9995 <= value < 1.0 else percent(value, digits)


def _informed(results: Results) -> list[str]:
    """How many parameters the data determine, and which they don't."""
    shares = _contractions(results)
    if not shares:
        return []
    well = [name for name, share in shares.items() if share >= INFORMED]
    none = [name for name, share in shares.items() if share < UNINFORMED]
    part = [name for name in shares if name not in well and name not in none]
    text = f"The data determine {len(well)} of {counted(len(shares), 'parameter')}: they remove more than half of the "
    text += "prior variance."
    if part:
        text += f" They determine {_some(part)} in part."
    if none:
        text += f" They carry hardly any information about {_some(none)}: the posterior is the prior."
    return [text]


def _directions(results: Results) -> list[str]:
    """The least and the best determined combination of parameters, per fit."""
    found = []
    for name, fit in fits(results).items():
        every = [d for d in mappings(fit.get("directions")) if is_number(d.get("contraction")) and d.get("words")]
        mixed = [d for d in every if " + " in str(d["words"]) or " - " in str(d["words"])]
        if len(every) < 2:
            continue
        least, best = every[0], every[-1]
        where = f" ({name})" if len(fits(results)) > 1 else ""
        text = (
            f"The least determined direction{where} is {_in_sentence(least)}: the data remove "
            f"{_share(least['contraction'])} of the prior variance along it."
        )
        if mixed and mixed[0] is not least:
            text += " Among combinations of several parameters the least determined is "
            text += f"{_shown(mixed[0])} ({_share(mixed[0]['contraction'])})."
        if is_number(best.get("information")):
            left = 1.0 / (1.0 + float(best["information"])) ** 0.5
            text += f" The best determined direction is {_in_sentence(best)}: {_share(left)} of the prior standard "
            text += "deviation remains."
        found.append(text)
    if found:
        found[-1] += " Parameters are scaled by their prior standard deviations."
    return found


def _shown(direction: Mapping[str, Any]) -> str:
    return str(direction["words"]).replace(" - ", " − ").replace("- ", "−", 1)


def _in_sentence(direction: Mapping[str, Any]) -> str:
    """A direction as a sum; one that is nearly a parameter by its name."""
    words = _shown(direction)
    alone = " + " not in words and " − " not in words
    return f"{words.partition(' ')[2]}, nearly alone" if alone else words


def _noise(results: Results) -> list[str]:
    """Share of the variances that is due to uncertain noise parameters, and which of these the data don't determine."""
    shares = {n: f for n, f in _parameters(results).items() if is_number(f.get("noise_share"))}
    if not shares:
        return []
    widened = (n for n in shares if shares[n]["noise_share"] >= NOISE_MATTERS)
    widened_most_first = sorted(widened, key=lambda n: -shares[n]["noise_share"])
    if widened_most_first:
        each = [
            f"{n} ({_share(shares[n]['noise_share'], 0)} of its variance; {_partner(shares[n])})"
            for n in widened_most_first
        ]
        found = [f"Uncertainty of the noise and wind parameters widens the posterior of {_some(each)}."]
    else:
        worst = max(shares, key=lambda n: float(shares[n]["noise_share"]))
        text = "Uncertainty of the noise and wind parameters hardly matters: it contributes at most "
        found = [text + f"{_share(shares[worst]['noise_share'])} of a posterior variance ({worst})."]
    return [*found, *_undetermined_noise(results)]


def _partner(facts: Mapping[str, Any]) -> str:
    label, correlation = plain(str(facts.get("noise_partner"))), number(facts.get("noise_correlation"), 2)
    return f"mostly “{label}”, correlation {correlation}"


def _undetermined_noise(results: Results) -> list[str]:
    """Noise parameters whose posterior is mostly their prior."""
    every = [part for fit in fits(results).values() if isinstance(part := fit.get("noise"), Mapping)]
    hardly: dict[str, int] = {}
    for part in every:
        for label, share in part.items():
            if is_number(share) and share < UNINFORMED:
                hardly[plain(str(label))] = hardly.get(plain(str(label)), 0) + 1
    if not hardly:
        return []
    names = [f"“{k}”" if len(every) == 1 else f"“{k}” (in {n} of {len(every)} fits)" for k, n in hardly.items()]
    text = f"Of {counted(max(len(part) for part in every), 'noise parameter')} the data hardly determine "
    return [f"{text}{'; '.join(names)}: the posterior of these is the prior of the study."]


def _diagnosis(facts: Mapping[str, Any]) -> str:
    """Diagnosis from both sensitivities and the shift of the mean from the prior."""
    prior, record, shift = (facts.get(key) for key in ("prior_sensitivity", "likelihood_sensitivity", "shift"))
    if not is_number(prior):
        return MISSING
    if prior < SENSITIVE:
        return INSENSITIVE
    if not is_number(record) or record < SENSITIVE:
        return PRIOR_ONLY
    return MAY_CONFLICT if is_number(shift) and abs(shift) >= CONFLICT else AGREE


def _prior(results: Results) -> list[str]:
    """Which posteriors are sensitive to the prior, and whether prior and data may conflict."""
    known = {n: f for n, f in _parameters(results).items() if is_number(f.get("prior_sensitivity"))}
    if not known:
        return []
    sensitive = {n: f for n, f in known.items() if f["prior_sensitivity"] >= SENSITIVE}
    if not sensitive:
        return ["No posterior is sensitive to the priors: a slightly stronger or weaker prior would hardly change it."]
    by_diagnosis: dict[str, list[str]] = {}
    for name, facts in sensitive.items():
        by_diagnosis.setdefault(_diagnosis(facts), []).append(name)
    alone, agree, conflict = (by_diagnosis.get(kind, []) for kind in (PRIOR_ONLY, AGREE, MAY_CONFLICT))
    found = []
    if alone:
        found.append(f"{_some(alone)} {'is' if len(alone) == 1 else 'are'} determined mostly by the prior.")
    if agree:
        found.append(f"Prior and data both determine {_some(agree)}, and they agree.")
    if conflict:
        moved = [f"{n} (shifted by {number(sensitive[n].get('shift'), 2)} prior standard deviations)" for n in conflict]
        found.append(f"Prior and data may be in conflict for {_some(moved)}: check the source of that prior.")
    rest = len(known) - len(sensitive)
    return [*found, f"The posterior of the other {rest} is insensitive to the prior."] if rest else found


def _intervals(results: Results) -> list[str]:
    """Profile-likelihood intervals, which do not depend on the prior, of parameters that are sensitive to it."""
    unbound, bound = [], []
    for name, facts in _parameters(results).items():
        ends = facts.get("likelihood_interval")
        if not isinstance(ends, Mapping):
            continue
        low, high = ends.get("low"), ends.get("high")
        scale, unit = shown_unit(str(ends.get("unit") or "1"))
        if is_number(low) and is_number(high):
            bound.append(f"{name} between {number(scale * low, 4)} and {number(scale * high, 4)} {unit}".rstrip())
        elif is_number(low) or is_number(high):
            word, end = ("above", low) if is_number(low) else ("below", high)
            bound.append(f"{name} only {word} {number(scale * (end or 0.0), 4)} {unit}".rstrip())
        else:
            unbound.append(name)
    found = []
    if unbound:
        own = "its own prior" if len(unbound) == 1 else "their own priors"
        where = "within three posterior standard deviations"
        found.append(f"Without {own} the profile likelihood does not bound {_some(unbound)} {where}.")
    if bound:
        own = "its own prior" if len(bound) == 1 else "their own priors"
        found.append(f"Without {own} the 90 % profile-likelihood interval puts {_some(bound)}.")
    return found


def identifiability_sentences(results: Results) -> list[str]:
    """What the data determine and what they do not, in words; nothing where the run didn't analyse it."""
    if not fits(results):
        return []
    return [s for part in (_informed, _directions, _noise, _prior, _intervals) for s in part(results)]


def identifiability_table(results: Results) -> Table | None:
    """Every parameter: contraction, share of variance from noise parameters, sensitivity to prior and likelihood."""
    contractions, rows = _contractions(results), []
    for name, facts in _parameters(results).items():
        partner = facts.get("noise_partner")
        by = Cell(_share(facts.get("noise_share")), "", plain(str(partner)) if partner else "")
        rows.append(
            cells(
                Cell(name, "code"),
                _share(contractions.get(name)),
                number(facts.get("shift"), 2) if is_number(facts.get("shift")) else MISSING,
                by,
                number(facts.get("noise_correlation"), 2) if is_number(facts.get("noise_correlation")) else MISSING,
                *(_sensitivity(facts.get(key)) for key in ("prior_sensitivity", "likelihood_sensitivity")),
                Cell(_diagnosis(facts), "wrap"),
            )
        )
    columns = columns_of(
        "Parameter:code|Contraction:num|Shift:num|Share:num|Correlation:num|Prior:num|Likelihood:num|Diagnosis:text"
    )
    groups = (("", 3), ("Noise parameters", 2), ("Power-scaling sensitivity", 3))
    caption = (
        "Contraction: share of the prior variance that the data remove. Shift: posterior mean minus prior mean, in "
        "prior standard deviations. Noise parameters: share of the posterior variance that is due to their "
        "uncertainty, and the one most correlated with the parameter. Sensitivity: change of the posterior when prior "
        "or likelihood is raised to a power near 1; values from 0.05 matter."
    )
    return Table(columns, tuple(rows), caption, groups, style="dense") if rows else None


def _sensitivity(value: Any) -> str:
    return f"{value:.3f}" if is_number(value) else MISSING


def direction_table(results: Results) -> Table | None:
    """The combinations of parameters that the data determine least."""
    several, rows = len(fits(results)) > 1, []
    for name, fit in fits(results).items():
        every = [d for d in mappings(fit.get("directions")) if is_number(d.get("contraction")) and d.get("words")]
        for d in every[:LEAST] if len(every) > 1 else ():
            left = (1.0 - float(d["contraction"])) ** 0.5 if d["contraction"] <= 1.0 else None
            rows.append(
                cells(
                    Cell(_shown(d), "code wrap", name if several else ""),
                    _share(d["contraction"]),
                    number(left, 2),
                )
            )
    columns = columns_of("Combination:code|Contraction:num|Posterior / prior sd:num")
    caption = "Combinations of parameters scaled by their prior standard deviations, the least determined first; small "
    return Table(columns, tuple(rows), caption + "weights are omitted.", style="narrow") if rows else None
