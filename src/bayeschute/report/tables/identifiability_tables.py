"""Practical identifiability: contraction, noise uncertainty, prior sensitivity and profile likelihood in words.

Sentences first, then the tables they come from. Contraction: 1 - posterior variance / prior variance. Sensitivity:
power scaling of prior and likelihood (Kallioinen et al. 2024). Profile likelihood: Raue et al. (2009).
"""

from __future__ import annotations

from typing import Any

from bayeschute.posterior.assess.identifiability_result import (
    AGREE,
    CONFLICT,
    FELT,
    INFORMED,
    INSENSITIVE,
    MAY_CONFLICT,
    PRIOR_ONLY,
    UNINFORMED,
    UNTOLD,
    Direction,
    FitIdentifiability,
    ParameterIdentifiability,
    diagnosis,
)
from bayeschute.report.run_results import Results
from bayeschute.report.sentences import plain
from bayeschute.report.tables.summary_tables import Cell, Table, cells, table_of
from bayeschute.report.wording import MISSING, counted, is_number, listed, number, percent, quantity

NOISE_MATTERS = 0.05  # share of a parameter's variance due to uncertain noise parameters, from which it is named
LEAST = 5  # combinations shown
MOST = 4  # names in a sentence


def _parameters(results: Results) -> dict[str, ParameterIdentifiability]:
    """Results by parameter, over all fits."""
    return {name: facts for fit in results.identifiability.values() for name, facts in fit.parameters.items()}


def _known_directions(fit: FitIdentifiability) -> list[tuple[Direction, float]]:
    """Directions with their contraction, where it is known."""
    return [(d, d.contraction) for d in fit.directions if d.contraction is not None and d.words]


def _contractions(results: Results) -> dict[str, float]:
    """Contraction of every parameter of the fits [1]."""
    return {name: one.contraction for name, one in _parameters(results).items() if one.contraction is not None}


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
    known = _parameters(results)
    little = [name for name, share in shares.items() if share < UNINFORMED]
    moved = [name for name in little if abs(known[name].shift or 0.0) >= CONFLICT]
    none = [name for name in little if name not in moved]
    part = [name for name in shares if name not in well and name not in little]
    text = f"The data determine {len(well)} of {counted(len(shares), 'parameter')}: they remove more than half of the "
    text += "prior variance."
    if part:
        text += f" They determine {_some(part)} in part."
    if none:
        text += f" They carry hardly any information about {_some(none)}: the posterior is the prior."
    if moved:
        text += f" They move {_some(moved)} away from the prior and leave it no narrower."
    if wider := [name for name, share in shares.items() if share < -UNINFORMED]:
        text += f" That of {_some(wider)} is wider than the prior, which says no more."
    return [text]


def _directions(results: Results) -> list[str]:
    """The least and the best determined combination of parameters, per fit."""
    found = []
    for name, fit in results.identifiability.items():
        every = _known_directions(fit)
        mixed = [one for one in every if " + " in one[0].words or " - " in one[0].words]
        if len(every) < 2:
            continue
        (least, removed), (best, _) = every[0], every[-1]
        where = f" ({name})" if len(results.identifiability) > 1 else ""
        text = (
            f"The least determined direction{where} is {_in_sentence(least)}: the data remove "
            f"{_share(removed)} of the prior variance along it."
        )
        if mixed and mixed[0][0] is not least:
            text += " Among combinations of several parameters the least determined is "
            text += f"{_shown(mixed[0][0])} ({_share(mixed[0][1])})."
        if best.information is not None:
            left = 1.0 / (1.0 + best.information) ** 0.5
            text += f" The best determined direction is {_in_sentence(best)}: {_share(left)} of the prior standard "
            text += "deviation remains."
        found.append(text)
    if found:
        found[-1] += " Parameters are scaled by their prior standard deviations."
    return found


def _shown(direction: Direction) -> str:
    return direction.words.replace(" - ", " − ").replace("- ", "−", 1)


def _in_sentence(direction: Direction) -> str:
    """A direction as a sum; one that is nearly a parameter by its name."""
    words = _shown(direction)
    alone = " + " not in words and " − " not in words
    return f"{words.partition(' ')[2]}, nearly alone" if alone else words


def _noise(results: Results) -> list[str]:
    """Share of the variances that is due to uncertain noise parameters, and which of these the data don't determine."""
    parameters = _parameters(results)
    shares = {n: facts.noise_share for n, facts in parameters.items() if facts.noise_share is not None}
    if not shares:
        return []
    widened = sorted((n for n in shares if shares[n] >= NOISE_MATTERS), key=lambda n: -shares[n])
    if widened:
        each = [f"{n} ({_share(shares[n], 0)} of its variance; {_partner(parameters[n])})" for n in widened]
        found = [f"Uncertainty of the noise and wind parameters widens the posterior of {_some(each)}."]
    else:
        worst = max(shares, key=lambda n: shares[n])
        text = "Uncertainty of the noise and wind parameters hardly matters: it contributes at most "
        found = [text + f"{_share(shares[worst])} of a posterior variance ({worst})."]
    return [*found, *_undetermined_noise(results)]


def _partner(facts: ParameterIdentifiability) -> str:
    label, correlation = plain(str(facts.noise_partner)), number(facts.noise_correlation, 2)
    return f"mostly “{label}”, correlation {correlation}"


def _undetermined_noise(results: Results) -> list[str]:
    """Noise parameters whose posterior is mostly their prior."""
    every = [fit.noise for fit in results.identifiability.values()]
    hardly: dict[str, int] = {}
    for part in every:
        for label, share in part.items():
            if share is not None and share < UNINFORMED:
                hardly[plain(label)] = hardly.get(plain(label), 0) + 1
    if not hardly:
        return []
    names = [f"“{k}”" if len(every) == 1 else f"“{k}” (in {n} of {len(every)} fits)" for k, n in hardly.items()]
    text = f"Of {counted(max(len(part) for part in every), 'noise parameter')} the data hardly determine "
    return [f"{text}{'; '.join(names)}: the posterior of these is the prior of the study."]


def _prior(results: Results) -> list[str]:
    """Which posteriors are sensitive to the prior, and whether prior and data may conflict."""
    by_diagnosis: dict[str | None, list[str]] = {}
    parameters = _parameters(results)
    for name, facts in parameters.items():
        by_diagnosis.setdefault(diagnosis(facts), []).append(name)
    by_diagnosis.pop(None, None)
    hidden = by_diagnosis.pop(UNTOLD, [])  # which `_informed` names
    if not by_diagnosis:
        return []
    if set(by_diagnosis) == {INSENSITIVE}:
        others = "No posterior" if not hidden else "No other posterior"
        return [f"{others} is sensitive to the priors: a slightly stronger or weaker prior would hardly change it."]
    alone, agree, felt, conflict = (by_diagnosis.get(kind, []) for kind in (PRIOR_ONLY, AGREE, FELT, MAY_CONFLICT))
    found = []
    if alone:
        found.append(f"{_some(alone)} {'is' if len(alone) == 1 else 'are'} determined mostly by the prior.")
    if agree:
        found.append(f"Prior and data both determine {_some(agree)}, and they agree.")
    if felt:
        found.append(f"The data determine {_some(felt)}, but not so well that the prior is not felt.")
    if conflict:
        moved = [f"{n} (shifted by {number(parameters[n].shift, 2)} prior standard deviations)" for n in conflict]
        found.append(f"Prior and data may be in conflict for {_some(moved)}: check the source of that prior.")
    rest = len(by_diagnosis.get(INSENSITIVE, []))
    return [*found, f"The posterior of the other {rest} is insensitive to the prior."] if rest else found


def _intervals(results: Results) -> list[str]:
    """Profile-likelihood intervals, which do not depend on the prior, of parameters that are sensitive to it."""
    unbound, bound = [], []
    for name, facts in _parameters(results).items():
        ends = facts.likelihood_interval
        if ends is None:
            continue
        low, high = ends.low, ends.high
        if low is not None and high is not None:
            bound.append(f"{name} between {quantity(low, ends.unit, 4)} and {quantity(high, ends.unit, 4)}")
        elif low is not None:
            bound.append(f"{name} only above {quantity(low, ends.unit, 4)}")
        elif high is not None:
            bound.append(f"{name} only below {quantity(high, ends.unit, 4)}")
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
    if not results.identifiability:
        return []
    return [s for part in (_informed, _directions, _noise, _prior, _intervals) for s in part(results)]


def identifiability_table(results: Results) -> Table | None:
    """Every parameter: contraction, share of variance from noise parameters, sensitivity to prior and likelihood."""
    rows = []
    for name, facts in _parameters(results).items():
        by = Cell(_share(facts.noise_share), "", plain(facts.noise_partner) if facts.noise_partner else "")
        rows.append(
            cells(
                Cell(name, "code"),
                _share(facts.contraction),
                number(facts.shift, 2),
                by,
                number(facts.noise_correlation, 2),
                _sensitivity(facts.prior_sensitivity),
                _sensitivity(facts.likelihood_sensitivity),
                Cell(diagnosis(facts) or MISSING, "wrap"),
            )
        )
    columns = (
        "Parameter:code|Contraction:num|Shift:num|Share:num|Correlation:num|Prior:num|Likelihood:num|Diagnosis:text"
    )
    groups = (("", 3), ("Noise parameters", 2), ("Power-scaling sensitivity", 3))
    caption = (
        "Contraction: share of the prior variance that the data remove. Shift: posterior mean minus prior mean, in "
        "prior standard deviations. Noise parameters: share of the posterior variance that is due to their "
        "uncertainty, and the one most correlated with the parameter. Sensitivity: change of the posterior when prior "
        "or likelihood is raised to a power near 1; values from 0.05 matter."
    )
    return table_of(columns, rows, caption, groups=groups, style="dense")


def _sensitivity(value: float | None) -> str:
    return MISSING if value is None else f"{value:.3f}"


def direction_table(results: Results) -> Table | None:
    """The combinations of parameters that the data determine least."""
    several, rows = len(results.identifiability) > 1, []
    for name, fit in results.identifiability.items():
        every = _known_directions(fit)
        for d, removed in every[:LEAST] if len(every) > 1 else ():
            left = (1.0 - removed) ** 0.5 if removed <= 1.0 else None
            rows.append(cells(Cell(_shown(d), "code wrap", name if several else ""), _share(removed), number(left, 2)))
    caption = "Combinations of parameters scaled by their prior standard deviations, the least determined first; small "
    columns = "Combination:code|Contraction:num|Posterior / prior sd:num"
    return table_of(columns, rows, caption + "weights are omitted.", style="narrow")
