"""What the record tells and what it does not: sentences first, then the tables they come from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.report.run_results import Results
from bayeschute.report.sentences import plain
from bayeschute.report.tables.summary_tables import Cell, Table, cells, columns_of, mappings
from bayeschute.report.wording import MISSING, counted, is_number, listed, number, percent, shown_unit

TOLD = 0.5  # share of the prior's variance taken away from which a parameter is told
HARDLY = 0.1  # and below which it hardly is
LEANS = 0.05  # share of a parameter's variance that noise parameters make, from which it is said
FELT = 0.05  # power-scaling sensitivity that is felt, as in `posterior.assess.identifiability`
APART = 1.0  # prior standard deviations by which the record moved a mean, from which prior and record pull apart
LEAST = 5  # combinations shown
HARDLY_MATTERS, ALONE = "the prior hardly matters", "mostly the prior"
TOGETHER, APART_WORDS = "both are felt, and agree", "prior and record may disagree"
MOST = 4  # names in a sentence


def fits(results: Results) -> dict[str, Mapping[str, Any]]:
    """What was found, by fit."""
    return {str(k): v for k, v in results.part("identifiability").items() if isinstance(v, Mapping)}


def _parameters(results: Results) -> dict[str, Mapping[str, Any]]:
    """Facts by parameter, over all fits."""
    found = (fit.get("parameters") for fit in fits(results).values())
    return {
        str(name): facts
        for part in found
        if isinstance(part, Mapping)
        for name, facts in part.items()
        if isinstance(facts, Mapping)
    }


def _contractions(results: Results) -> dict[str, float]:
    """Share of the prior's variance taken away, of the parameters of the fits."""
    summary = results.part("parameters")
    entries = {name: summary.get(name) for name in _parameters(results)}
    told = {name: facts.get("contraction") for name, facts in entries.items() if isinstance(facts, Mapping)}
    return {name: float(share) for name, share in told.items() if is_number(share)}


def _some(items: list[str]) -> str:
    """Items as in a sentence; what is too many for it is in the table."""
    rest = len(items) - MOST
    return listed(items if rest <= 1 else [*items[:MOST], f"{rest} others (see the table)"])


def _share(value: Any, digits: int = 1) -> str:
    """A share in percent, never rounded up to all."""
    return "> 99.9 %" if is_number(value) and 0.9995 <= value < 1.0 else percent(value, digits)


def _told(results: Results) -> list[str]:
    """How many parameters the record tells, and which it doesn't."""
    shares = _contractions(results)
    if not shares:
        return []
    well = [name for name, share in shares.items() if share >= TOLD]
    none = [name for name, share in shares.items() if share < HARDLY]
    part = [name for name in shares if name not in well and name not in none]
    text = f"Of {counted(len(shares), 'parameter')} the record tells {len(well)}: it takes away more than half of "
    text += "the variance that the prior left."
    if part:
        text += f" It tells {_some(part)} in part."
    if none:
        text += f" It says hardly anything about {_some(none)}: what stands there is the prior."
    return [text]


def _directions(results: Results) -> list[str]:
    """The least and the best told combination of several parameters, per fit."""
    found = []
    for name, fit in fits(results).items():
        every = [d for d in mappings(fit.get("directions")) if is_number(d.get("contraction")) and d.get("words")]
        mixed = [d for d in every if " + " in str(d["words"]) or " - " in str(d["words"])]
        if len(every) < 2:
            continue
        least, best = every[0], every[-1]
        where = f" ({name})" if len(fits(results)) > 1 else ""
        text = (
            f"Least told{where} is {_in_sentence(least)}: the record takes away {_share(least['contraction'])} of the "
        )
        text += "prior's variance along it."
        if mixed and mixed[0] is not least:
            text += f" Of mixtures the least told is {_shown(mixed[0])} ({_share(mixed[0]['contraction'])})."
        if is_number(best.get("information")):
            left = 1.0 / (1.0 + float(best["information"])) ** 0.5
            text += f" Best told is {_in_sentence(best)}: {_share(left)} of the prior's standard deviation is left."
        found.append(text)
    if found:
        found[-1] += " Each parameter counts in standard deviations of its prior."
    return found


def _shown(direction: Mapping[str, Any]) -> str:
    return str(direction["words"]).replace(" - ", " − ").replace("- ", "−", 1)


def _in_sentence(direction: Mapping[str, Any]) -> str:
    """A direction as a sum; one that is nearly a parameter by its name."""
    words = _shown(direction)
    alone = " + " not in words and " − " not in words
    return f"{words.partition(' ')[2]}, nearly alone" if alone else words


def _noise(results: Results) -> list[str]:
    """Which parameters noise and wind stand in for, and what is not known of these."""
    shares = {n: f for n, f in _parameters(results).items() if is_number(f.get("noise_share"))}
    if not shares:
        return []
    leaning = sorted((n for n in shares if shares[n]["noise_share"] >= LEANS), key=lambda n: -shares[n]["noise_share"])
    if leaning:
        each = [f"{n} ({_share(shares[n]['noise_share'], 0)} of its variance; {_partner(shares[n])})" for n in leaning]
        found = [f"Not knowing exactly how strong and lasting noise and wind are widens {_some(each)}."]
    else:
        worst = max(shares, key=lambda n: float(shares[n]["noise_share"]))
        text = "Not knowing exactly how strong and lasting noise and wind are hardly matters: it makes at most "
        found = [text + f"{_share(shares[worst]['noise_share'])} of a variance ({worst})."]
    return [*found, *_hardly_known(results)]


def _partner(facts: Mapping[str, Any]) -> str:
    label, correlation = plain(str(facts.get("noise_partner"))), number(facts.get("noise_correlation"), 2)
    return f"foremost “{label}”, correlation {correlation}"


def _hardly_known(results: Results) -> list[str]:
    """Noise parameters that the records hardly tell."""
    every = [part for fit in fits(results).values() if isinstance(part := fit.get("noise"), Mapping)]
    hardly: dict[str, int] = {}
    for part in every:
        for label, share in part.items():
            if is_number(share) and share < HARDLY:
                hardly[plain(str(label))] = hardly.get(plain(str(label)), 0) + 1
    if not hardly:
        return []
    names = [f"“{k}”" if len(every) == 1 else f"“{k}” (in {n} of {len(every)} fits)" for k, n in hardly.items()]
    text = f"Of {counted(max(len(part) for part in every), 'noise parameter')} the record hardly tells "
    return [f"{text}{'; '.join(names)}: there the study's own values stand."]


def _reading(facts: Mapping[str, Any]) -> str:
    """What the sensitivities and the move from the prior mean together."""
    prior, record, shift = (facts.get(key) for key in ("prior_sensitivity", "likelihood_sensitivity", "shift"))
    if not is_number(prior):
        return MISSING
    if prior < FELT:
        return HARDLY_MATTERS
    if not is_number(record) or record < FELT:
        return ALONE
    return APART_WORDS if is_number(shift) and abs(shift) >= APART else TOGETHER


def _prior(results: Results) -> list[str]:
    """Where the prior is felt, and whether it pulls against the record."""
    known = {n: f for n, f in _parameters(results).items() if is_number(f.get("prior_sensitivity"))}
    if not known:
        return []
    felt = {n: f for n, f in known.items() if f["prior_sensitivity"] >= FELT}
    if not felt:
        return ["No parameter feels its prior: made a little stronger or weaker, it would change hardly anything."]
    by_reading: dict[str, list[str]] = {}
    for name, facts in felt.items():
        by_reading.setdefault(_reading(facts), []).append(name)
    alone, together, apart = (by_reading.get(reading, []) for reading in (ALONE, TOGETHER, APART_WORDS))
    found = []
    if alone:
        found.append(f"{_some(alone)} {'hangs' if len(alone) == 1 else 'hang'} mostly on the prior.")
    if together:
        found.append(f"Prior and record both shape {_some(together)}, and they agree.")
    if apart:
        moved = [f"{n} (moved by {number(felt[n].get('shift'), 2)} standard deviations of its prior)" for n in apart]
        found.append(f"Prior and record may pull apart for {_some(moved)}: look at where that prior comes from.")
    rest = len(known) - len(felt)
    return [*found, f"For the other {rest} the prior hardly matters."] if rest else found


def _intervals(results: Results) -> list[str]:
    """What the record alone would say of parameters that feel their prior."""
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
        text = "Were its own prior taken away" if len(unbound) == 1 else "Were their own priors taken away"
        where = "within three standard deviations of the posterior"
        found.append(f"{text}, the record would set no bounds to {_some(unbound)} {where}.")
    if bound:
        own = "its own prior" if len(bound) == 1 else "their own priors"
        found.append(f"Without {own} the record puts {_some(bound)} (90 % of profile likelihood).")
    return found


def told_sentences(results: Results) -> list[str]:
    """What the record tells and what it does not, in words; nothing where the run didn't ask."""
    if not fits(results):
        return []
    return [s for part in (_told, _directions, _noise, _prior, _intervals) for s in part(results)]


def told_table(results: Results) -> Table | None:
    """Every parameter: what the record took away, what noise and prior add."""
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
                Cell(_reading(facts), "wrap"),
            )
        )
    columns = columns_of(
        "Parameter:code|Told:num|Moved:num|Share:num|Correlation:num|Prior:num|Record:num|Reading:text"
    )
    groups = (("", 3), ("From noise", 2), ("Sensitivity", 3))
    caption = (
        "Told: share of the prior's variance that the record takes away. Moved: mean, in standard deviations of the "
        "prior. From noise: share of the variance that unknown noise parameters make, and the one most correlated. "
        "Sensitivity: change of the posterior when prior or likelihood is made a little stronger; felt from 0.05."
    )
    return Table(columns, tuple(rows), caption, groups, style="dense") if rows else None


def _sensitivity(value: Any) -> str:
    return f"{value:.3f}" if is_number(value) else MISSING


def direction_table(results: Results) -> Table | None:
    """The least told combinations of the parameters."""
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
    columns = columns_of("Combination:code|Told:num|Standard deviation left:num")
    caption = "Combinations of parameters, in standard deviations of their priors, from the least told; small weights "
    return Table(columns, tuple(rows), caption + "left out.", style="narrow") if rows else None
