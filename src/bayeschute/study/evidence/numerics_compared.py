"""Numerics that give the same results: finished runs of both, compared, and stored with their figures.

The hash of the numerics changes with every line of them. Results stored by earlier ones count as those of the present
ones for a configuration (`identity.configuration`) of which several studies were run by both and differ by less than
draws of one posterior do: see `Figures.same`. Flights of other kinds may take other paths through the same code. Only
direct comparisons with the numerics in use count; a chain of small changes may add up.

Code that was only written differently gives the same numbers, but for rounding where sums are taken in another order.
Iterations and chains let that grow: to 4e-5 standard deviations of a parameter of the default study, and 6e-4 of the
dropsondes' population. Where runs of several kinds differ by no more, results of every kind count, along a chain of
such changes too, as a hundred of them would come to what draws differ by: see `Comparison.identical`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict

from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.shipped import shipped

STORED = Path("reference", "numerics")
"""Where a folder of models, or the package, keeps comparisons."""
LEAST_STUDIES = 3
"""Fewest studies of a configuration of which a comparison counts."""
LEAST_KINDS = 3
"""Fewest configurations whose runs are the same but for rounding, of numerics that are the same for all."""
ROUNDING = 1e-3
"""Largest differences, in the units of `Bounds`, that rounding may leave."""


class Bounds(NamedTuple):
    """Largest differences at which results count as the same; 400 to 2,000 draws of one posterior differ by as much.

    Attributes:
        mean: Of a parameter's posterior means, over their standard deviation.
        sd: Of the logarithms of its posterior standard deviations.
        band: Root mean square difference of the limits of a 90 % band, over its mean width.
        width: Of the logarithms of mean widths.
    """

    mean: float = 0.15
    sd: float = 0.10
    band: float = 0.10
    width: float = 0.05


BOUNDS = Bounds()


class Figures(BaseModel):
    """What two runs of a study by different numerics differ by; the largest over parameters, or bands.

    Attributes:
        study: Its title.
        hash: Of the study (see `study.study_hash`).
        configuration: Of how it identifies (see `identity.configuration`).
        mean: See `Bounds`.
        sd: Likewise.
        band: Likewise, over flights and quantities.
        width: Likewise.
        seconds: Clock times of the fits before and after [s].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    study: str
    hash: str
    configuration: str
    mean: float
    sd: float
    band: float
    width: float
    seconds: tuple[float, float]

    @property
    def same(self) -> bool:
        """Whether they are as alike as draws of one posterior."""
        return all(getattr(self, name) <= bound for name, bound in BOUNDS._asdict().items())

    @property
    def identical(self) -> bool:
        """Whether means, standard deviations and bands are the same but for rounding."""
        return all(getattr(self, name) <= ROUNDING for name in BOUNDS._fields)


class Comparison(BaseModel):
    """Two numerics on the same studies.

    Attributes:
        before: Hash of the earlier numerics.
        after: Of the later ones.
        studies: What the runs differ by.
        provenance: Command, commit, date, machine, versions.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    before: str
    after: str
    studies: tuple[Figures, ...]
    provenance: dict[str, object]

    def same(self, configuration: str) -> bool:
        """Whether results of one count as those of the other, for a configuration."""
        told = [one for one in self.studies if one.configuration == configuration]
        return len({one.hash for one in told}) >= LEAST_STUDIES and all(one.same for one in told)

    @property
    def identical(self) -> bool:
        """Whether results of one are those of the other, for every configuration."""
        kinds = {one.configuration for one in self.studies}
        return len(kinds) >= LEAST_KINDS and all(one.identical for one in self.studies)


def comparisons(place: Path | None = None) -> list[Comparison]:
    """Stored comparisons.

    Args:
        place: Folder; that which comes with the program where None.

    Raises:
        pydantic.ValidationError: If a file is no comparison.
    """
    folder = shipped(STORED) if place is None else place
    return [Comparison.model_validate_json(file.read_bytes()) for file in sorted(folder.glob("*.json"))]


def identical_to(hash_of_numerics: str, found: Sequence[Comparison]) -> frozenset[str]:
    """Numerics that are the same as some numerics but for rounding, they themselves among them.

    Args:
        hash_of_numerics: Their hash.
        found: Comparisons.
    """
    alike, pairs = frozenset({hash_of_numerics}), [{one.before, one.after} for one in found if one.identical]
    while more := frozenset().union(*(pair for pair in pairs if alike & pair)) - alike:
        alike |= more
    return alike


def same_as(hash_of_numerics: str, configuration: str, found: Sequence[Comparison]) -> frozenset[str]:
    """Numerics whose results of a configuration count as those of some numerics.

    Args:
        hash_of_numerics: Their hash.
        configuration: That the results are of.
        found: Comparisons.

    Returns:
        They themselves, those compared with them, and those identical to one of these.
    """
    alike = identical_to(hash_of_numerics, found)
    pairs = [{one.before, one.after} for one in found if one.same(configuration)]
    compared = alike.union(*(pair for pair in pairs if alike & pair))
    return frozenset().union(*(identical_to(one, found) for one in compared))


@cache
def present_numerics(configuration: str) -> frozenset[str]:
    """Hashes of the numerics whose stored results of a configuration count as those of the numerics in use."""
    return same_as(numerics(), configuration, comparisons())
