"""Rank tests of the inference (simulation-based calibration), and the table of their result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from bayeschute.api import html
from bayeschute.api.fitting import shown
from bayeschute.api.inputs import Study
from bayeschute.study.job import Progress


@dataclass(frozen=True, eq=False, repr=False)
class RankTest:
    """Whether the ranks of true values among posterior draws are uniform.

    Attributes:
        found: As `bayeschute calibrate --ranks` stores it.

    Example:
        >>> one = {"value": 0.02, "bound": 0.001, "passed": True, "mean_rank": 0.51}
        >>> bc.RankTest({"replicates": 100, "passed": True, "quantities": {"axial[1]": one}}).passed
        True
    """

    found: Mapping[str, Any]

    @property
    def table(self) -> pd.DataFrame:
        """Test value, bound and mean rank (uniform: 0.5) by quantity."""
        return pd.DataFrame.from_dict(self.found["quantities"], orient="index")

    @property
    def passed(self) -> bool:
        """Whether the ranks of all quantities are uniform, in bands that hold for all of them together."""
        return bool(self.found["passed"])

    def __repr__(self) -> str:
        """Verdict and table."""
        says = "uniform" if self.passed else "not uniform"
        return f"Ranks over {self.found['replicates']} replicates are {says}\n{self.table}"

    def _repr_html_(self) -> str:
        """The tests as a table."""
        rows = [(n, f"{r['value']:.4f}", f"{r['bound']:.4f}") for n, r in self.found["quantities"].items()]
        return html.table(repr(self).splitlines()[0], ("quantity", "least probability", "bound"), rows)


def rank_test(
    study: Study,
    folder: Path | str,
    replicates: int = 100,
    *,
    truths: str = "posterior",
    workers: int = 1,
    progress: Progress | bool | None = None,
) -> RankTest:
    """Test the inference by simulation-based calibration: ranks of truths, with records of the model itself.

    Args:
        study: A cluster study whose fitted flights are virtual; the first is used, with the terms that it flies.
        folder: Stores finished replicates; the same call continues a stopped one.
        replicates: Number of replicates.
        truths: ``posterior``: drawn from the posterior of the study's own record, fitted together with each
            replicate's; ``prior``: from the priors.
        workers: Local processes.
        progress: Progress bars if True, or a function called with a name, the share done and words.

    Raises:
        InputError: If study or arguments are invalid, or `folder` contains replicates of another test.

    Example:
        >>> bc.rank_test(bc.Study.load("mine.toml"), "runs/ranks", replicates=100)  # doctest: +SKIP
    """
    from bayeschute.study.rank_tests import rank_tests

    with shown(progress) as tell:
        say = None if tell is None else partial(tell, "ranks")
        return RankTest(rank_tests(study.spec, folder, replicates, truths, workers, None, say))
