"""Simulated landings and the decisions that follow from them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from bayeschute.api import html
from bayeschute.api.quantity import central, si
from bayeschute.calibration.label import caveat
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.netcdf_files import write_netcdf
from bayeschute.core.version import __version__
from bayeschute.landing.decisions import requirements
from bayeschute.landing.decisions.requirements import Judgement, Limit, Requirement, judge
from bayeschute.landing.measures import IDS, LABELS, MEASURES, ON_LEVEL_GROUND, OUTCOMES, ROW
from bayeschute.report.wording import shown_unit
from bayeschute.study.landing_campaign.campaign_schema import DesignTable, PlacardTable
from bayeschute.study.schema.schema_faults import validated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bayeschute.api.landing.landing_answers import DropRanking, Placard, RareFailures, Sensitivity
    from bayeschute.api.landing.landing_source import LandingSource

Rows = NDArray[np.void]
_FORMAT = 1
_SHOWN = ("vertical_speed", "sea_level_vertical_speed", "horizontal_speed", "swing_amplitude", "hang_angle")
"""Measures told in notebooks and on the terminal."""


@dataclass(frozen=True, eq=False, repr=False)
class Landings:
    """Landings: a row each, of a draw of the parameters in a wind, with a start, gusts and canopies of its own.

    Attributes:
        name: Of the campaign.
        rows: Structured array of `landing.measures.ROW`, SI.
        requirements: What the campaign asks of them.
        parameters: Draws of the parameters (draw,) by name, in their own units.
        failed_checks: Of the posterior: with one or more, nothing that follows has a level of trust.
        source: How further landings are flown; None: they were read from a file.
        level: Of trust, of the posterior, as `Run.level` has it; empty: not asked.

    Example:
        >>> found = landings.requirement(vertical_speed="40 ft/s", probability=0.5)
        >>> found.verdict.verdict
        'met'
        >>> landings.exceedance("vertical_speed", [0.0])["probability"].tolist()
        [1.0]
    """

    name: str
    rows: Rows
    requirements: tuple[Requirement, ...]
    parameters: Mapping[str, NDArray[np.float64]]
    failed_checks: tuple[str, ...] = ()
    source: LandingSource | None = None
    level: str = ""

    @cached_property
    def table(self) -> xr.Dataset:
        """All rows, dimension ``landing``, with units and meanings; labels and outcomes in words."""
        made = xr.Dataset({name: ("landing", self.rows[name]) for name in (*IDS, "profile")})
        words = np.array(["failed", *LABELS])
        made["outcome"] = ("landing", np.array(OUTCOMES)[self.rows["outcome"]])
        made["label"] = ("landing", words[self.rows["label"] + 1])
        for name, (unit, meaning) in MEASURES.items():
            made[name] = ("landing", self.rows[name], {"units": unit, "long_name": meaning})
        made.attrs = {"campaign": self.name, "version": __version__}
        return made

    @property
    def failed(self) -> int:
        """Landings whose simulation failed; they meet no requirement and exceed every threshold."""
        return int((self.rows["outcome"] != 0).sum())

    def _known(self, quantity: str) -> str:
        if quantity not in MEASURES:
            raise InputError(Fault("quantity", repr(quantity), f"one of {', '.join(MEASURES)}"))
        return MEASURES[quantity][0]

    def summary(self, level: float = 0.9) -> pd.DataFrame:
        """Every measure of the landings that did not fail: median and central interval.

        Args:
            level: Probability in the interval [1].

        Returns:
            A row per measure, indexed by it: ``low``, ``median``, ``high``, ``unit``; angles in deg, as in figures.

        Example:
            >>> landings.summary().loc["vertical_speed", "unit"]
            'm/s'
        """
        fine = self.rows[self.rows["outcome"] == 0]
        made = pd.DataFrame({name: fine[name] for name in MEASURES}).quantile(list(central(level))).T
        made.columns = pd.Index(("low", "median", "high"))
        shown = [shown_unit(unit) for unit, _ in MEASURES.values()]
        made = made.mul([scale for scale, _ in shown], axis=0)
        return made.assign(unit=[unit or "1" for _, unit in shown]).rename_axis("measure")

    def requirement(
        self, *, probability: float = 0.95, confidence: float = 0.9, name: str = "", **at_most: str | float
    ) -> Judgement:
        """P(all limits are kept by a landing), its spreads, and a verdict.

        Args:
            probability: Least probability [1].
            confidence: Posterior probability with which it must be reached [1].
            name: For tables; the limits' own words where empty.
            **at_most: Upper limits by quantity, such as ``vertical_speed="36 ft/s"``, or numbers in SI.

        Raises:
            InputError: If no limit is given, or a quantity is not known.
        """
        if not at_most:
            raise InputError(Fault("requirement", "no limit", "one or more, such as vertical_speed='36 ft/s'"))
        limits = []
        for quantity, limit in at_most.items():
            limits.append(Limit(quantity, si(quantity, limit, self._known(quantity))))
        said = name or " and ".join(f"{q} <= {limit}" for q, limit in at_most.items())
        return judge(Requirement(said, tuple(limits), probability, confidence), self.rows)

    def judgements(self) -> list[Judgement]:
        """The campaign's own requirements, judged."""
        return [judge(one, self.rows) for one in self.requirements]

    def exceedance(self, quantity: str, thresholds: ArrayLike | None = None, confidence: float = 0.9) -> pd.DataFrame:
        """P(quantity > threshold) with limits over the posterior and for the number of landings; see `landing`.

        Args:
            quantity: One of the table's.
            thresholds: In SI; None: twenty-one over what was seen.
            confidence: Of the limits, two-sided [1].
        """
        self._known(quantity)
        return requirements.exceedance(self.rows, quantity, thresholds, confidence)

    def modes(self) -> pd.Series:
        """Share of the landings by what the cluster did before touchdown."""
        fine = self.rows["label"][self.rows["outcome"] == 0]
        return pd.Series({word: float((fine == i).mean()) if fine.size else np.nan for i, word in enumerate(LABELS)})

    def plot(self, quantity: str = "vertical_speed") -> Figure:
        """Where landings lie, with ellipses, and how likely a quantity exceeds a threshold."""
        from bayeschute.report.figures.landing_figures import landing_figure

        self._known(quantity)
        return landing_figure(self.rows, quantity, self._limits)

    def plot_scatter(self, ax: Axes | None = None) -> Axes:
        """Where landings lie from the start, with ellipses, on axes of your own or on new ones (``.figure``).

        Example:
            >>> landings.plot_scatter().get_xlabel()
            'east of the start [m]'
        """
        from bayeschute.report.figures.canvas import axes_or_new
        from bayeschute.report.figures.landing_figures import scatter

        return scatter(axes_or_new(ax, 5.0, 5.0), self.rows)

    def plot_exceedance(self, quantity: str = "vertical_speed", ax: Axes | None = None) -> Axes:
        """How likely a quantity exceeds a threshold, on axes of your own or on new ones (``.figure``).

        Args:
            quantity: One of the table's.
            ax: Where to draw.

        Raises:
            InputError: If the quantity is not known.

        Example:
            >>> landings.plot_exceedance().get_yscale()
            'log'
        """
        from bayeschute.report.figures.canvas import axes_or_new
        from bayeschute.report.figures.landing_figures import exceedance_curve

        table = self.exceedance(quantity)
        return exceedance_curve(axes_or_new(ax), table, quantity, self._limits)

    @property
    def _source(self) -> LandingSource:
        if self.source is None:
            do = "Fly them again by `Posterior.land`; with the same `folder` they are read from there."
            raise InputError(Fault("landings", "landings read from a file", "those that `Posterior.land` returned", do))
        return self.source

    def sensitivity(self, samples: int = 512) -> Sensitivity:
        """What drives landings: shares of the variance of limited quantities and of failing.

        Sobol's shares of parameters, winds, start, gusts, canopies and, where it is drawn, the surface (Saltelli's
        design, Jansen's estimators), by `samples` x 7 or 8 more landings; and Shapley shares of single parameters, by a
        linear model.

        Args:
            samples: Of each base sample of the design.

        Raises:
            InputError: If the campaign has no requirement.

        Example:
            >>> sorted(set(landings.sensitivity(64).table["kind"]))
            ['first', 'shapley', 'total']
        """
        from bayeschute.api.landing.landing_questions import sensitivity

        return sensitivity(self._source, self.rows, samples)

    def rare_failures(self, samples: int = 1000) -> RareFailures:
        """P(a requirement is not met) down to 1e-5, by subset simulation (Au and Beck 2001).

        Args:
            samples: Of each level.

        Raises:
            InputError: If the campaign has no requirement.

        Example:
            >>> landings.rare_failures(64).table["requirement"].tolist()
            ['soft', 'upright']
        """
        from bayeschute.api.landing.landing_questions import rare_failures

        return rare_failures(self._source, samples)

    def placard(self, **table: Any) -> Placard:
        """P(pendulum) and go, no-go or can't tell by shear and payload, all with the same draws, winds and starts.

        Args:
            **table: Entries of ``[placard]`` of a campaign file, such as ``shear=["0 m/s", "6 m/s"]``,
                ``capsule_mass=["9000 kg"]``; none: the campaign's own.

        Raises:
            InputError: With every fault, or if there is no shear.

        Example:
            >>> landings.placard(shear=["3 m/s"], landings=64).table["shear_m_per_s"].tolist()
            [3.0]
        """
        from bayeschute.api.landing.landing_questions import wind_placard

        return wind_placard(self._source, validated(PlacardTable, "placard", table) if table else None)

    def rank_drops(self, candidates: Path | str | None = None, *, interval: str | None = None) -> DropRanking:
        """Drops that might be flown next, by how much each would shrink the spread of the first requirement's P(met).

        Each is flown three times by the posterior's mean, and its records are fitted with the posterior as prior.

        Args:
            candidates: TOML of ``[[flight]]`` tables with virtual drops, see docs/landing.md; None: the campaign's.
            interval: A parameter whose standard deviation is to shrink, in place of that spread.

        Raises:
            InputError: If there is no requirement, no such parameter, no candidate, or their file has faults.

        Example:
            >>> landings.rank_drops("candidate-drops.toml").plot()  # doctest: +SKIP
        """
        from bayeschute.api.landing.landing_questions import drop_ranking

        table = self._source.campaign.tables.design
        if candidates is not None:
            table = DesignTable(candidates=str(Path(candidates).resolve()), interval=interval)
        elif table is not None and interval is not None:
            table = table.model_copy(update={"interval": interval})
        return drop_ranking(self._source, self.rows, table)

    def to_jsbsim(self, path: Path | str, draw: int | None = None) -> Path:
        """Write the canopies as an ``<aerodynamics>`` section of JSBSim: tables over the total angle of attack.

        All canopies are one rigid body at their steady fly-out angle. What that can't hold, and where the force acts,
        is said in the file and in docs/landing.md.

        Args:
            path: Where to; ``.xml``.
            draw: Number of a draw of the parameters, as in the table's ``draw``; None: means over all draws. A
                Monte Carlo study takes a file for each.

        Raises:
            InputError: If there is no such draw, the name is not one of an XML file, the canopies have no steady
                fly-out angle, or the landings were read from a file.

        Example:
            >>> landings.to_jsbsim(folder / "canopies.xml").read_text().count("<tableData>")
            3
        """
        from bayeschute.api.landing.other_programs_files import write_jsbsim

        return write_jsbsim(self._source.plan, self.name, Path(path), draw)

    def to_rocketpy(self, folder: Path | str) -> Path:
        """Write parachutes for RocketPy: numbers of all draws (JSON), and a module that makes parachutes of them.

        The module needs no bayeschute: ``rocket.add_parachute(**rocketpy_parachutes.arguments(draw=17))``. What
        RocketPy's point of mass can't hold is said in docs/landing.md.

        Args:
            folder: Where to; made if missing.

        Returns:
            The module, ``rocketpy_parachutes.py``.

        Raises:
            InputError: If the canopies have no steady fly-out angle, or the landings were read from a file.

        Example:
            >>> module = landings.to_rocketpy(folder)
            >>> module.with_suffix(".json").exists()
            True
        """
        from bayeschute.api.landing.other_programs_files import write_rocketpy

        return write_rocketpy(self._source.plan, self.name, Path(folder))

    @property
    def _limits(self) -> list[Limit]:
        """Limits of the campaign's requirements."""
        return [limit for one in self.requirements for limit in one.limits]

    def save(self, path: Path | str) -> Path:
        """Write one NetCDF file.

        Example:
            >>> path = landings.save(folder / "landings.nc")
            >>> len(bc.Landings.load(path).rows) == len(landings.rows)
            True
        """
        path = Path(path)
        made = xr.Dataset({name: ("landing", self.rows[name]) for name in ROW.names or ()})
        for name, (unit, meaning) in MEASURES.items():
            made[name].attrs = {"units": unit, "long_name": meaning}
        for i, values in enumerate(self.parameters.values()):
            made[f"parameter_{i}"] = ("posterior_draw", values)
        asked = [{**one._asdict(), "limits": [tuple(limit) for limit in one.limits]} for one in self.requirements]
        said = {
            "format": _FORMAT, "name": self.name, "requirements": asked, "parameters": list(self.parameters),
            "failed_checks": self.failed_checks, "level": self.level,
        }  # fmt: skip
        made.attrs = {"bayeschute_landings": json.dumps(said), "version": __version__}
        write_whole(path, partial(write_netcdf, made))
        return path

    @classmethod
    def load(cls, path: Path | str) -> Landings:
        """Read landings that `save` wrote.

        Raises:
            InputError: If the file is not one.
        """
        path = Path(path)
        wanted = "landings written by `Landings.save` or `bayeschute land`"
        if not path.is_file():
            raise InputError(Fault(str(path), "no such file", wanted))
        try:
            held = xr.load_dataset(path, engine="h5netcdf")
            said = json.loads(held.attrs["bayeschute_landings"])
            if said["format"] != _FORMAT:
                raise ValueError(f"format {said['format']}")
            rows = np.zeros(held.sizes["landing"], ROW)
            old = "surface" not in held  # written when all ground was level: rows then had no measures against it
            for name in ROW.names or ():
                rows[name] = _of_level_ground(held, name) if old and name not in held else held[name].values
        except (OSError, KeyError, ValueError) as error:
            raise InputError(Fault(str(path), f"a file that can't be read ({error})"[:200], wanted)) from None
        asked = tuple(
            Requirement(r["name"], tuple(Limit(*limit) for limit in r["limits"]), r["probability"], r["confidence"])
            for r in said["requirements"]
        )
        drawn = {name: held[f"parameter_{i}"].values for i, name in enumerate(said["parameters"])}
        return cls(said["name"], rows, asked, drawn, tuple(said.get("failed_checks", ())), level=said.get("level", ""))

    def __repr__(self) -> str:
        """Campaign, landings and draws, and what their posterior lacks."""
        draws = len(np.unique(self.rows["draw"]))
        told = f"Landings of {self.name}: {len(self.rows)} with {draws} draws of the parameters, {self.failed} failed"
        return "; ".join(filter(None, (told, caveat(self.failed_checks, self.level))))

    def _repr_html_(self) -> str:
        """Medians and 90 % intervals as a table."""
        return html.summary(repr(self), "at touchdown", self.summary().loc[list(_SHOWN)])


def _of_level_ground(held: xr.Dataset, name: str) -> Any:
    """A measure against the surface, of landings that were written without."""
    if name == "surface":
        return held["wind"].values  # landings of a campaign have one number
    if name in ON_LEVEL_GROUND:
        return held[ON_LEVEL_GROUND[name]].values
    if name.startswith("surface_"):
        return np.where(held["outcome"].values == 0, 0.0, np.nan)
    raise KeyError(name)


def requirement_table(judged: Sequence[Judgement]) -> pd.DataFrame:
    """Judgements as a table, a row each."""
    rows = []
    for one in judged:
        c, v = one.chance, one.verdict
        rows.append(
            {
                "requirement": one.requirement.name,
                "wanted_probability": one.requirement.probability,
                "wanted_confidence": one.requirement.confidence,
                "probability_met": c.met,
                "posterior_low": c.low,
                "posterior_high": c.high,
                "epistemic_sd": c.epistemic_sd,
                "aleatory_sd": c.aleatory_sd,
                "monte_carlo_sd": c.monte_carlo_sd,
                "posterior_probability_reached": v.reached,
                "verdict": v.verdict,
                "more_draws_factor": v.more_draws,
                "more_drops": v.more_drops,
                "landings": c.landings,
                "draws": c.draws,
                "failed": c.failed,
            }
        )
    return pd.DataFrame(rows)


def stopping(asked: Sequence[Requirement]) -> Callable[[Rows], tuple[bool, str]]:
    """Whether landings so far decide all requirements, as far as more of them could, and what to say meanwhile."""

    def enough(rows: Rows) -> tuple[bool, str]:
        judged = [judge(one, rows) for one in asked]
        told = "; ".join(
            f"{one.requirement.name}: {one.verdict.verdict}, P {one.chance.met:.3f} +- {one.chance.monte_carlo_sd:.3f}"
            for one in judged
        )
        return bool(judged) and all(one.verdict.more_draws == 1.0 for one in judged), told

    return enough


def in_words(landings: Landings, judged: Sequence[Judgement]) -> list[str]:
    """What was found, line by line."""
    lines = [repr(landings)]
    for name in _SHOWN:
        low, middle, high = (float(q) for q in np.nanquantile(landings.rows[name], (0.05, 0.5, 0.95)))
        lines.append(f"{name}: {middle:.4g} {MEASURES[name][0]}, central 90 % {low:.4g} to {high:.4g}")
    shares: Mapping[Any, float] = landings.modes().to_dict()
    lines.append("before touchdown: " + ", ".join(f"{k} {100 * v:.1f} %" for k, v in shares.items() if v > 0.0))
    for one in judged:
        c = one.chance
        lines.append(
            f"{one.requirement.name}: {one.verdict.verdict}. P(met) {c.met:.4f}; {100 * c.confidence:g} % over the "
            f"posterior {c.low:.3f} to {c.high:.3f}; landing to landing sd {c.aleatory_sd:.3f}; "
            f"Monte Carlo error {c.monte_carlo_sd:.4f}. {one.verdict.why}"
        )
    return lines
