"""Which laws a record breaks, and the mistakes that explain it, the likeliest first.

Every mistake is undone in turn, and all laws are tried again: what is left of the breaches is its score. So a mistake
comes first where undoing it makes most laws hold, whatever the symptom was. Where one is not enough, the next is sought
with the first undone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayeschute.records.plausibility import motion_laws, vehicle_laws
from bayeschute.records.plausibility.estimated_mistakes import estimated_mistakes
from bayeschute.records.plausibility.evidence import Evidence
from bayeschute.records.plausibility.mistake import Mistake
from bayeschute.records.plausibility.mistakes import known_mistakes
from bayeschute.records.plausibility.reading import FAULT, WARNING, Reading

Law = Callable[[Evidence], Iterable[Reading]]
LAWS: tuple[Law, ...] = (*motion_laws.LAWS, *vehicle_laws.LAWS)
_MOST_MISTAKES = 3  # made in one record
_OTHERS = 3  # further causes that are told
_NEAR = 1.0  # scores of other causes that are told lie this close to the best
_LOST = 2.0  # score of a law that can't be tried any more
_TIE = 3  # decimals of a misfit that tell two mistakes apart


@dataclass(frozen=True)
class Finding:
    """A law that a record breaks, or nearly.

    Attributes:
        law: Its name; a study may accept its breach by it.
        tests: What was compared.
        got: The statistic.
        wanted: Its limit.
        excess: Statistic over limit.
        severity: ``fault`` or ``warning``.
        causes: Mistakes that explain it, the likeliest first; empty where none does.
        do: What to do about the likeliest.
    """

    law: str
    tests: str
    got: str
    wanted: str
    excess: float
    severity: str
    causes: tuple[str, ...] = ()
    do: str = ""

    @property
    def likely(self) -> str:
        """The likeliest cause; empty where none is known."""
        return self.causes[0] if self.causes else ""


@dataclass(frozen=True)
class Verdict:
    """What the laws say of a record.

    Attributes:
        readings: Every law that could be tried.
        findings: Those that are broken, faults first.
        causes: Mistakes that together explain the faults, the one that explains most first.
        evidence: The record as the laws saw it.
    """

    evidence: Evidence
    readings: tuple[Reading, ...]
    findings: tuple[Finding, ...]
    causes: tuple[str, ...] = ()

    @property
    def faults(self) -> tuple[Finding, ...]:
        """Findings that no record can have."""
        return tuple(one for one in self.findings if one.severity == "fault")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings to look at."""
        return tuple(one for one in self.findings if one.severity == "warning")


def readings(e: Evidence) -> dict[str, Reading]:
    """Every law that the channels, and what is known of the vehicle, allow, by name."""
    return Laws(e).readings(e)


class _Watched(Evidence):
    """Evidence that notes which of its fields are read."""

    def __getattribute__(self, name: str) -> Any:
        own = object.__getattribute__(self, "__dict__")
        if name in own and "read" in own:
            own["read"].add(name)
        return object.__getattribute__(self, name)


class Laws:
    """The laws, and what they say of a record: undoing a mistake changes few channels, and most laws read others.

    What a law reads next depends on nothing but what it has read. So where all that it read is the same, it says the
    same.
    """

    def __init__(self, e: Evidence) -> None:
        """Try every law.

        Args:
            e: The record.
        """
        self._record, self._said = vars(e), list[tuple[set[str], list[Reading]]]()
        with np.errstate(all="ignore"):
            for law in LAWS:
                watched = object.__new__(_Watched)
                watched.__dict__.update(self._record, read=set[str]())
                told = list(law(watched))
                self._said.append((watched.__dict__["read"], told))

    def readings(self, e: Evidence) -> dict[str, Reading]:
        """As the function of this name, of evidence of which some fields are those of the record."""
        own = vars(e)
        with np.errstate(all="ignore"):
            each = [
                told if all(own[name] is self._record[name] for name in read) else law(e)
                for law, (read, told) in zip(LAWS, self._said, strict=True)
            ]
            return {found.law: found for told in each for found in told if not np.isnan(found.excess)}


def misfit(found: dict[str, Reading], of: Sequence[str]) -> float:
    """Sum of the logarithms by which laws are off: one that is broken a thousandfold does not outweigh all others."""
    excess = np.array([found[law].excess if law in found else np.expm1(_LOST) ** 0.5 for law in of])
    return float(np.sum(np.log1p(np.minimum(excess, 1e3) ** 2)))


@dataclass(frozen=True)
class _Tried:
    mistake: Mistake
    score: float
    after: dict[str, Reading]
    evidence: Evidence

    def mends(self, law: str, limit: float) -> bool:
        """Whether a law holds without the mistake."""
        return law in self.after and self.after[law].excess < limit


def _tried(e: Evidence, laws: Laws, names: Sequence[str]) -> list[_Tried]:
    """Every mistake, undone; the best first, and of those that explain alike the first of the catalogue."""
    import warnings

    def score(x: Evidence) -> float:
        return misfit(laws.readings(x), names)

    out = []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # means of nothing: a law that can't be tried is none
        for mistake in (*known_mistakes(), *estimated_mistakes(e, score)):
            made = mistake.undone(e)
            if made is not None:
                after = laws.readings(made)
                out.append(_Tried(mistake, misfit(after, names) + mistake.doubt, after, made))
    return sorted(out, key=lambda one: round(one.score, _TIE))


def verdict(e: Evidence) -> Verdict:
    """Try every law on a record, and explain those that it breaks.

    Args:
        e: The evidence.
    """
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        laws = Laws(e)
        first = laws.readings(e)
    broken = [law for law, found in first.items() if found.excess >= FAULT]
    near = [law for law, found in first.items() if WARNING <= found.excess < FAULT]
    told: dict[str, tuple[tuple[str, ...], str]] = {}
    causes: list[str] = []
    now, left = e, list(broken or near)
    for _ in range(_MOST_MISTAKES if left else 0):
        before = misfit(laws.readings(now), list(first))
        tried = _tried(now, laws, list(first))
        if not tried or tried[0].score > before - 0.3:
            break
        best = tried[0]
        solved = [law for law in left if law not in best.after or best.after[law].excess < FAULT]
        solved = solved if broken else left
        if not solved:
            break
        causes.append(best.mistake.cause)
        near_best = [one for one in tried[1:] if one.score < best.score + _NEAR]
        for law in solved:
            others = [one.mistake.cause for one in near_best if one.mends(law, FAULT if broken else WARNING)][:_OTHERS]
            told.setdefault(law, ((best.mistake.cause, *others), best.mistake.do))
        now, left = best.evidence, [law for law in left if law not in solved]
        if not left:
            break
        laws = Laws(now)
    found = [_finding(first[law], *told.get(law, ((), ""))) for law in (*broken, *near)]
    return Verdict(e, tuple(first.values()), tuple(found), tuple(causes))


def _finding(r: Reading, causes: tuple[str, ...], do: str) -> Finding:
    severity = "fault" if r.excess >= FAULT else "warning"
    return Finding(r.law, r.tests, r.got, r.wanted, r.excess, severity, causes, do)
