"""`Fit`: flights fitted, with mode, noise parameters and how well the search ended."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from bayeschute.api import html
from bayeschute.api.workspace import Files
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.priors import values_and_sds
from bayeschute.report.wording import counted
from bayeschute.study.run.stage_fit import Fitted
from bayeschute.study.study import Study as StudySpec


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Flights fitted: mode of the marginal posterior, noise parameters, and how well the search ended.

    Attributes:
        spec: The study that was fitted.
        groups: One entry per set of flights that share their parameters.
        files: Records, priors and structure, for what comes next.

    Example:
        >>> fitted.converged
        True
        >>> list(fitted.parameters.columns)
        ['mode', 'sd', 'unit']
    """

    spec: StudySpec
    groups: tuple[Fitted, ...]
    files: Files

    @property
    def converged(self) -> bool:
        """Whether every search ended at a mode."""
        return all(one.found.optimum.converged and one.found.profile.is_mode for one in self.groups)

    @property
    def parameters(self) -> pd.DataFrame:
        """Mode and standard deviation of every parameter by Laplace's approximation, in its unit."""
        rows = []
        for one in self.groups:
            best, priors = one.found.optimum, one.group.priors
            for prior, mode, sd in zip(priors, *values_and_sds(priors, best.theta, best.covariance), strict=True):
                rows.append({"parameter": prior.name, "mode": float(mode), "sd": float(sd), "unit": prior.unit})
        return pd.DataFrame(rows).set_index("parameter")

    @property
    def noise(self) -> list[NoiseParameters]:
        """Noise parameters at the mode, SI, of every set of flights that was fitted together."""
        return [one.found.hyper for one in self.groups]

    @property
    def notes(self) -> list[str]:
        """What is left out since it can't be trusted: corrections, or how weak the noise of a record is."""
        return [lost for one in self.groups for lost in one.found.lost]

    def __repr__(self) -> str:
        """Flights, parameters and whether the search converged."""
        names = ", ".join(f.name for one in self.groups for f in one.group.flights)
        said = "converged" if self.converged else "not converged"
        return f"Fit of {names}: {counted(len(self.parameters), 'parameter')}, {said}"

    def _repr_html_(self) -> str:
        """Mode and standard deviation as a table."""
        rows = [(n, html.number(r["mode"]), html.number(r["sd"]), r["unit"]) for n, r in self.parameters.iterrows()]
        return html.table(repr(self), ("parameter", "mode", "standard deviation", "unit"), rows, "; ".join(self.notes))
