"""External knowledge beside the posterior, proposed terms, and the information gained from the flights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.aero.coefficient import Coefficient
from bayeschute.report.run_results import Results, mappings
from bayeschute.report.tables.summary_tables import Cell, Table, cells, table_of
from bayeschute.report.wording import MISSING, is_number, listed, number, percent

ASKED, WORTH = 0.05, 0.01  # chance of any candidate below which, share of the force from which a term is proposed
_KIND = {"agreement": "good", "tension": "weak", "conflict": "bad"}


def _known(results: Results) -> list[Mapping[str, Any]]:
    return mappings(results.summary.get("knowledge"))


def knowledge_sentences(results: Results) -> list[str]:
    """Whether what others know agrees with the flights, one sentence each."""
    found = []
    for one in _known(results):
        target, name = one.get("target"), f"{one.get('name')} ({one.get('source')})"
        if not one.get("in_model"):
            found.append(f"{name} speaks of {target}, of which the model has no term: it counts as zero there.")
        p = f"p = {number(one.get('p_value'), 2)}"
        words = {
            "agreement": f"{name} agrees with what the flights say of {target} ({p}).",
            "tension": f"{name} is in tension with what the flights say of {target} ({p}).",
            "conflict": f"{name} and the flights contradict each other about {target} ({p}): one of them, or the form "
            "of the model, is wrong by more than it says.",
        }
        text = words.get(str(one.get("verdict")), "")
        if text and one.get("counted"):
            text += " It is part of the prior and the flights tell too little without it: the conflict may be greater."
        found += [text] if text else []
    return found


def knowledge_table(results: Results) -> Table | None:
    """Every coefficient and curve that others know, with the largest difference and the p-value of all together."""
    rows = []
    for one in _known(results):
        z = [float(x) for x in one.get("z") or () if is_number(x)]
        worst = max(range(len(z)), key=lambda i: abs(z[i])) if z else None
        values, found = one.get("values") or [], one.get("found") or []
        pair = (MISSING, MISSING)
        if worst is not None and worst < min(len(values), len(found)):
            sds = one["sd"][worst], one["found_sd"][worst]
            first, second = (
                f"{number(v, 3)} ± {number(s, 2)}" for v, s in zip((values[worst], found[worst]), sds, strict=True)
            )
            pair = first, second
        verdict = str(one.get("verdict"))
        rows.append(
            cells(
                Cell(str(one.get("name")), "", str(one.get("source"))), str(one.get("target")),
                "prior" if one.get("use") == "prior" else "compared", pair[0], pair[1],
                MISSING if worst is None else number(z[worst], 2), number(one.get("p_value"), 2),
                Cell(verdict, _KIND.get(verdict, "")),
            )
        )  # fmt: skip
    caption = (
        "Known and found (with standard deviations) where they differ most, their difference over its standard "
        "deviation, and the p-value of all differences together. What was used as prior was taken out of the posterior "
        "for this comparison."
    )
    return table_of("knowledge:text|of:code|use:text|known:num|found:num|z:num|p:num|verdict:text", rows, caption)


def proposal_sentence(results: Results) -> str:
    """Which term the latent forces ask for, in a sentence; empty where a run does not say."""
    found = mappings(results.summary.get("proposals"))
    if not found:
        return ""
    sure = [one for one in found if is_number(one.get("p_any")) and one["p_any"] < ASKED]
    asked = [one for one in sure if not is_number(one.get("share")) or one["share"] >= WORTH]
    if not asked:
        by = f", or by as much as {percent(WORTH)} of their variance" if sure else ""
        return (
            "The latent forces of the fit, which hold what no term explains, follow none of the terms that the model "
            f"lacks more than chance would{by}."
        )
    words = [
        f"{_proposed(one)} explains {percent(one.get('share'))} of the latent {one.get('kind')} force" for one in asked
    ]
    text = "What no term of the model explains follows terms that it lacks: "
    return f"{text}{listed(words)}. Try them among the candidates."


def _proposed(one: Mapping[str, Any]) -> str:
    return str(Coefficient(str(one.get("kind")), str(one.get("term"))))


def proposal_table(results: Results) -> Table | None:
    """Terms that the latent forces follow, the strongest of each kind."""
    rows = [
        cells(
            _proposed(one), percent(one.get("share"), 1), number(one.get("coefficient"), 2),
            number(one.get("z"), 2), number(one.get("p_value"), 2), number(one.get("p_any"), 2),
        )
        for one in mappings(results.summary.get("proposals"))
    ]  # fmt: skip
    caption = (
        "Share of the latent force's variance that a term the model lacks explains, beyond what its own terms could; "
        "z: its coefficient (of the relative change, for the axial force) over its standard error, which allows for "
        "autocorrelation; p: of this term by itself; p of any: that the best of all candidates reaches this by chance."
    )
    return table_of("term:code|share:num|coefficient:num|z:num|p:num|p of any:num", rows, caption)


def _coordinate(row: Mapping[str, Any]) -> str:
    """What a parameter's standard deviations are of, where that is not its value."""
    known = str(row.get("coordinate") or ("logarithm" if row.get("logarithmic") else "value"))
    return {"logarithm": "of its logarithm", "value": ""}.get(known, known)


def taught_table(results: Results) -> Table | None:
    """Information gained about every parameter from the flights [nats]."""
    told = results.part("taught")
    rows = [
        cells(
            Cell(str(one.get("name")), "", _coordinate(one)),
            number(one.get("prior_sd"), 3), number(one.get("sd"), 3), number(one.get("shift"), 2),
            number(one.get("gain"), 2),
        )
        for one in mappings(told.get("parameters"))
    ]  # fmt: skip
    flights = listed([str(f) for f in told.get("flights") or ()])
    caption = (
        f"What {flights} taught: standard deviations before and after, shift of the mean in standard deviations of the "
        "prior, and information gained about each parameter by itself; about all of them together "
        f"{number(told.get('joint'), 3)} nats."
    )
    return table_of("parameter:code|prior sd:num|posterior sd:num|shift:num|gain [nats]:num", rows, caption)
