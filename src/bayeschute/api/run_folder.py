"""`Run`: a run in a folder, with its posterior, forecasts and report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from bayeschute.api import html
from bayeschute.api.forecast import Forecast, forecast_of, stored_forecast_of
from bayeschute.api.inputs import Study
from bayeschute.api.posterior import Posterior
from bayeschute.api.workspace import collected, workspace
from bayeschute.calibration.label import CONTRADICTED
from bayeschute.study.job import Job
from bayeschute.study.run.stages import has_ended
from bayeschute.study.study import Flight


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Run:
    """A run in a folder, finished or as far as it went.

    Attributes:
        folder: The folder.
        study: The study as it ran; where none is given, the one that the run keeps in its folder.

    Example:
        >>> run = bc.Run(folder / "run", study)
        >>> run, run.level
        (Run('...run': not finished), 'not checked')
    """

    folder: Path
    study: Study

    def __init__(self, folder: Path | str, study: Study | None = None) -> None:
        """Open a run's folder.

        Raises:
            InputError: If no study is given and the folder has none.
        """
        object.__setattr__(self, "folder", Path(folder))
        object.__setattr__(self, "study", Study.load(self.folder / "study.toml") if study is None else study)

    @property
    def summary(self) -> dict[str, Any]:
        """summary.json; empty where the last stage has not run."""
        path = self.folder / "summary.json"
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}

    @property
    def level(self) -> str:
        """Level of trust in the intervals, such as ``self-consistent``: the first words of the run's label.

        ``contradicted by its own data`` is no level and says so; ``not checked`` also where no label was written.
        """
        claim = self.summary.get("claim", {})
        return CONTRADICTED if claim.get("contradicted") else str(claim.get("level", "not checked"))

    @cached_property
    def posterior(self) -> Posterior:
        """The posterior."""
        return Posterior.of_run(self.folder, self.study.spec)

    @cached_property
    def forecasts(self) -> Mapping[str, Forecast]:
        """Forecasts of the flights that were fitted or predicted, by name: the run's own draws.

        Where the run has not come so far, or keeps a part of its draws only, they are drawn anew.
        """
        return _Forecasts(self)

    def report(self) -> Path:
        """Build report.html from the results; returns its path."""
        from bayeschute.report.page import build_report

        return build_report(self.folder)

    def __repr__(self) -> str:
        """Folder and label."""
        return f"Run({str(self.folder)!r}: {self.summary.get('label', 'not finished')})"

    def _repr_html_(self) -> str:
        """Label, what was promised, checks and requirements as a table."""
        told = self.summary
        rows = [("level", self.level), *(("trust", text) for text in told.get("claim", {}).get("sentences", ()))]
        passed = {name: one.get("passed") for name, one in told.get("checks", {}).items()}
        missed = ", ".join(name for name, one in passed.items() if one is False)
        if passed:
            words = f"{sum(one is True for one in passed.values())} passed" + (f", missed: {missed}" if missed else "")
            rows.append(("checks", words))
        for one in told.get("requirements", ()):
            met = one["probability_met"]
            rows.append(
                (f"{one['name']} on {one['run']}", "P(met) is not known" if met is None else f"P(met) = {met:.3f}")
            )
        finished = "finished" if told else "not finished"
        return html.table(f"Run in {self.folder}: {finished}", ("of", "told"), rows)


class _Forecasts(Mapping[str, Forecast]):
    """Forecasts of a run, read or made when asked for."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._made: dict[str, Forecast] = {}

    def __getitem__(self, name: str) -> Forecast:
        if name not in self._made:
            study = self._run.study.spec
            flight = next((f for f in study.flights if f.name == name and f.name in set(self)), None)
            if flight is None:
                raise KeyError(f"no forecast {name!r}; there are {', '.join(self)}")
            self._made[name] = replace(self._stored(flight) or self._drawn(flight), level=self._run.level)
        return self._made[name]

    def _stored(self, flight: Flight) -> Forecast | None:
        if not has_ended(self._run.folder, "predict"):  # what lies there may be of an earlier fit
            return None
        return stored_forecast_of(Job(self._run.study.spec, self._run.folder, False, "", lambda *_: None), flight)

    def _drawn(self, flight: Flight) -> Forecast:
        with workspace(self._run.study.spec, collected(self._run.folder)) as job:
            return forecast_of(job, flight)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def __iter__(self) -> Any:
        return iter([f.name for f in self._run.study.spec.flights if {"identify", "predict"} & set(f.roles)])

    def __len__(self) -> int:
        return len(list(iter(self)))
