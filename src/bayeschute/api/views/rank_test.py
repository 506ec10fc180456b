"""Rank tests of the inference (simulation-based calibration), and the table of their result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bayeschute.api import html
from bayeschute.api.inputs import Study


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
        return pd.DataFrame(self.found["quantities"]).T

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
    progress: Callable[[float, str], None] | None = None,
) -> RankTest:
    """Test the inference by simulation-based calibration: ranks of truths, with records of the model itself.

    Args:
        study: A cluster study whose fitted flights are virtual; the first is used, with the terms that it flies.
        folder: Stores finished replicates; the same call continues a stopped one.
        replicates: Number of replicates.
        truths: ``posterior``: drawn from the posterior of the study's own record, fitted together with each
            replicate's; ``prior``: from the priors.
        workers: Local processes.
        progress: Called with a share done and words.

    Example:
        >>> bc.rank_test(bc.Study.load("mine.toml"), "runs/ranks", replicates=100)  # doctest: +SKIP
    """
    from bayeschute.study.rank_tests import rank_tests

    return RankTest(rank_tests(study.spec.path, folder, replicates, truths, workers, None, progress))


__all__ = ["RankTest", "rank_test"]
