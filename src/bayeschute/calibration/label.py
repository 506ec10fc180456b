"""Levels of trust in a run's intervals, and the label that states the level, its evidence and its limits.

The levels form a ladder. A rung that applies to the run and does not hold ends the climb; a run that its own checks or
held-out shares contradict has no level, whatever was stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Any


class Level(IntEnum):
    """Levels, from none to the strongest."""

    NOT_CHECKED = 0
    SELF_CONSISTENT = 1
    OTHER_PROGRAMS = 2
    RECORDED = 3

    @property
    def words(self) -> str:
        """The level as it is printed."""
        return _WORDS[self]

    @property
    def meaning(self) -> str:
        """What the level says, in a sentence."""
        return _MEANINGS[self]


_WORDS = {
    Level.NOT_CHECKED: "not checked",
    Level.SELF_CONSISTENT: "self-consistent",
    Level.OTHER_PROGRAMS: "held on other programs' flights",
    Level.RECORDED: "held on recorded flights",
}
_WHAT_NOW = (
    "Causes, and what to try, are told by statistic in the how-to of the documentation, under “Contradicted by its own "
    "data”. Until then the bands may serve to compare flights; they are no probabilities."
)
_MEANINGS = {
    Level.NOT_CHECKED: "There is not enough evidence that the stated probabilities apply to this run.",
    Level.SELF_CONSISTENT: (
        "The intervals contained the truth as often as stated on flights made by this program's own simulator. That "
        "tests the computation, not the model: it says nothing of errors of mass, geometry, wind or aerodynamic form."
    ),
    Level.OTHER_PROGRAMS: (
        "The bands contained the held-out parts of flights that other simulation programs made, as often as stated."
    ),
    Level.RECORDED: "The bands contained the held-out parts of recorded flights as often as stated.",
}
CONTRADICTED = "contradicted by its own data"
"""First words of the label of a run whose own checks or held-out shares contradict its intervals."""


@dataclass(frozen=True)
class Rung:
    """Evidence for one level.

    Attributes:
        level: The level that it supports.
        lacking: What is missing or outside, in words; empty: the rung holds.
        kept: What held, with the number of replicates or flights, in words.
        applies: Whether the climb ends where the rung does not hold.
    """

    level: Level
    lacking: tuple[str, ...] = ()
    kept: str = ""
    applies: bool = True


@dataclass(frozen=True, repr=False)
class Claim:
    """What a run or a posterior may claim of its intervals.

    Attributes:
        level: The level.
        evidence: What held, with the number of replicates or flights; empty without a level.
        lacking: Why the level is not higher.
        contradicted: By which of its own checks or held-out shares; such a run has no level.
        misspecification: Worst stored coverage with a wrong model, in words; empty where none is stored.
        not_promised: Results that the run shows and that no calibration speaks for.
        extrapolated: Sentences on predictions that go where no fitted flight has been.
    """

    level: Level
    evidence: str = ""
    lacking: tuple[str, ...] = ()
    contradicted: tuple[str, ...] = ()
    misspecification: str = ""
    not_promised: tuple[str, ...] = ()
    extrapolated: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The label in one line: contradiction, or the level with its evidence, then the worst misspecification."""
        if self.contradicted:
            text = f"{CONTRADICTED}, no level: {'; '.join(self.contradicted)}"
        elif self.level is Level.NOT_CHECKED:
            why = "; ".join(self.lacking)
            text = why if why.startswith(self.level.words) else f"{self.level.words}: {why}"
        else:
            text = f"{self.level.words}: {self.evidence}"
        if self.misspecification:
            return f"{text}; worst case stored of a wrong model: {self.misspecification}"
        return text if self.level is Level.NOT_CHECKED else f"{text}; no case of a wrong model is stored"

    @property
    def words(self) -> str:
        """The level in few words, or that the data contradict the intervals."""
        return CONTRADICTED if self.contradicted else self.level.words

    def __repr__(self) -> str:
        """The label."""
        return f"Claim({self.label!r})"

    def __str__(self) -> str:
        """The label, and what a reader must know beside it."""
        return "\n".join([self.label, *self.sentences])

    @property
    def sentences(self) -> list[str]:
        """What a reader must know beside the label."""
        made = [self.level.meaning, *([_WHAT_NOW] if self.contradicted else [])]
        if self.level is not Level.NOT_CHECKED and self.lacking:
            made.append(f"The level is not higher: {'; '.join(self.lacking)}.")
        if self.contradicted and self.lacking:
            made.append(f"Independently of that, no level would apply: {'; '.join(self.lacking)}.")
        if self.level is Level.NOT_CHECKED:
            made.append("Nothing is promised: neither parameters nor bands, requirements or landings.")
        elif self.not_promised:
            made.append(f"Not promised by any calibration: {', '.join(self.not_promised)}.")
        return [*made, *self.extrapolated]

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        own = {"level": self.level.words, "rank": int(self.level), "sentences": self.sentences}
        return asdict(self) | own


def claim(
    rungs: Sequence[Rung],
    contradicted: Sequence[str] = (),
    misspecification: str = "",
    not_promised: Sequence[str] = (),
    failed: Sequence[str] = (),
) -> Claim:
    """What a run may claim: the level of the last rung that holds before one that applies and does not.

    Args:
        rungs: In the order of their levels.
        contradicted: By which of the run's own checks or held-out shares.
        misspecification: Worst stored coverage with a wrong model, in words.
        not_promised: Results that no calibration speaks for.
        failed: Checks of the computation that failed; such a run has no level either.
    """
    level, evidence, lacking = Level.NOT_CHECKED, "", list[str]()
    for rung in sorted(rungs, key=lambda rung: rung.level):
        if not rung.lacking:
            level, evidence = rung.level, rung.kept
        elif rung.applies:
            lacking += rung.lacking
            break
    if level is Level.NOT_CHECKED and not lacking:
        lacking = [part for rung in rungs for part in rung.lacking] or ["no evidence is stored"]
    if contradicted or failed:
        level, evidence = Level.NOT_CHECKED, ""
    if failed:
        lacking.insert(0, f"failed checks: {', '.join(failed)}")
    return Claim(level, evidence, tuple(lacking), tuple(contradicted), misspecification, tuple(not_promised))


MOST_LOST = 0.02
"""Share of a flight's predicted simulations that may fail: were all outside, a 90 % band would hold 88 %."""


def lost_simulations(flight: str, failed: int, drawn: int) -> str:
    """What is said of a flight of whose `drawn` simulations more than `MOST_LOST` failed; empty where fewer did."""
    if failed <= MOST_LOST * drawn:
        return ""
    bands = "it has no bands" if failed == drawn else "its bands are of the others"
    return f"{failed:,} of {drawn:,} simulations of {flight} failed: {bands}"


def caveat(failed: Sequence[str], level: str) -> str:
    """What is said beside a number: failed checks of what it comes from, else its level of trust.

    Args:
        failed: Names of the checks.
        level: As `Claim.words` has it; empty: not asked.
    """
    if failed or not level:
        return without_level(failed)
    return f"{CONTRADICTED}, no level of trust" if level == CONTRADICTED else f"level of trust: {level}"


def without_level(failed: Sequence[str]) -> str:
    """What is said beside numbers of a posterior with failed checks; empty where none failed."""
    return f"no level of trust, failed checks: {', '.join(failed)}" if failed else ""


def has_level(label: str) -> bool:
    """Whether a label states a level."""
    return any(label.startswith(f"{level.words}:") for level in Level if level is not Level.NOT_CHECKED)
