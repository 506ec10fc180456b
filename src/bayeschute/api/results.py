"""`Fit`, `Posterior`, `Forecast` and `Run`: results of fits, sampling, prediction and whole runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayeschute.api import html
from bayeschute.api.beliefs import Priors
from bayeschute.api.curve import Curve, curve
from bayeschute.api.drop_by_drop import HISTORY, next_priors, priors_of, taught_table
from bayeschute.api.fitting import chosen, drawn, fitted_flights, sampling
from bayeschute.api.inputs import Flight, Study
from bayeschute.api.workspace import KEPT, Files, collected, workspace
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.units import to_si
from bayeschute.core.version import __version__
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.assess.flight_groups import for_loo_pit
from bayeschute.prediction import bands
from bayeschute.prediction.flight_statistics import REDUCTIONS
from bayeschute.prediction.requirement import requirement_check
from bayeschute.study.aerodynamics.agreement import agreement
from bayeschute.study.aerodynamics.flown import flown, ranges
from bayeschute.study.aerodynamics.term_proposals import as_rows, proposed_terms
from bayeschute.study.archive import study_from_plain, study_to_plain
from bayeschute.study.assembly.fits import groups, load_fit
from bayeschute.study.assembly.lessons import lessons
from bayeschute.study.evidence.recalibrate import widening
from bayeschute.study.job import Progress
from bayeschute.study.run.forecasts import forecast_flight, widened
from bayeschute.study.run.stage_data import ingest_flight
from bayeschute.study.run.stage_fit import Fitted
from bayeschute.study.run.stage_results import recorded_quantities
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.stage_keys import ARTEFACT_VERSION
from bayeschute.study.study import Study as StudySpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
_GROUP, _SPEC = "bayeschute", "study"


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
            sds = np.sqrt(np.diag(one.found.optimum.covariance))
            for prior, at, sd in zip(one.group.priors, one.found.optimum.theta, sds, strict=True):
                value = float(prior.value(at))
                spread = float(sd) * (abs(value) if prior.logarithmic else 1.0)
                rows.append({"parameter": prior.name, "mode": value, "sd": spread, "unit": prior.unit})
        return pd.DataFrame(rows).set_index("parameter")

    @property
    def noise(self) -> list[Any]:
        """Noise parameters of every group."""
        return [one.found.hyper for one in self.groups]

    @property
    def notes(self) -> list[str]:
        """Corrections that had to be left out, since they can't be trusted."""
        return [lost for one in self.groups for lost in one.found.lost]

    def __repr__(self) -> str:
        """Flights, parameters and whether the search converged."""
        names = ", ".join(f.name for one in self.groups for f in one.group.flights)
        said = "converged" if self.converged else "not converged"
        return f"Fit of {names}: {len(self.parameters)} parameters, {said}"

    def _repr_html_(self) -> str:
        """Mode and standard deviation as a table."""
        rows = [(n, html.number(r["mode"]), html.number(r["sd"]), r["unit"]) for n, r in self.parameters.iterrows()]
        return html.table(repr(self), ("parameter", "mode", "standard deviation", "unit"), rows, "; ".join(self.notes))


@dataclass(frozen=True, eq=False, repr=False)
class Posterior:
    """Draws of the parameters given the flights, with what it takes to ask them about another flight.

    A posterior needs no folder: `save` writes one NetCDF file that ArviZ reads, and `load` reads it anywhere.

    Attributes:
        spec: The study that was fitted, with the fitted flights.
        data: ArviZ DataTree; its groups are those of `posterior.sampler.data_tree`.
        files: Records and fits.

    Example:
        >>> draws = posterior[posterior.names[0]]
        >>> draws.dims
        ('chain', 'draw')
        >>> len(posterior.summary()) == len(posterior.names)
        True
    """

    spec: StudySpec
    data: xr.DataTree
    files: Files

    def __getitem__(self, name: str) -> xr.DataArray:
        """Draws of a parameter (chain, draw) in its unit."""
        return self.data["posterior"].to_dataset()[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(map(str, self.data["posterior"].data_vars))

    def summary(self, **options: Any) -> pd.DataFrame:
        """Mean, standard deviation, intervals and diagnostics of every parameter: `arviz_stats.summary`."""
        import arviz_stats

        return arviz_stats.summary(self.data, **options)

    def for_loo_pit(self, flight: str, channel: str | None = None) -> xr.DataTree:
        """What `arviz_stats.loo_pit` and `arviz_plots.plot_loo_pit` need; see `assess.flight_groups.for_loo_pit`.

        Args:
            flight: Name of a fitted flight.
            channel: One of its outputs; all together where None.

        Raises:
            InputError: If there is no such flight or output.
        """
        return for_loo_pit(self.data, flight, channel)

    def _json(self, name: str) -> Any:
        return json.loads(self.files[name]) if name in self.files else {}

    def checks(self) -> pd.DataFrame:
        """Checks of fit and draws: whether each passed, its value and bound, and what it means."""
        return pd.DataFrame(self._json("checks.json").get("checks", {})).T

    def identifiability(self) -> pd.DataFrame:
        """What the records tell of every parameter beyond its prior."""
        told = self._json("identifiability.json")
        rows = {name: entry for group in told.values() for name, entry in group["parameters"].items()}
        return pd.DataFrame(rows).T

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return bool(self.checks()["passed"].all())

    @cached_property
    def _flown(self) -> list[Any]:
        with workspace(self.spec, self.files) as job:
            return flown(job)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Central 99 % of what the fitted flights flew: alpha [rad]; D_prox, reduced rate and V/V_o [1]."""
        return ranges(self._flown) if self._flown else {}

    def _draws(self, group: str) -> dict[str, Array]:
        held = self.data[group].to_dataset() if group in self.data.children else xr.Dataset()
        return {str(name): held[name].values for name in held.data_vars}

    def curve(
        self,
        name: str,
        level: float = 0.9,
        points: int = 61,
        *,
        over: tuple[float, float] | None = None,
        distance: float | None = None,
        speed: float = 1.0,
    ) -> Curve:
        """A force coefficient as a curve with its band, over the range that the fitted flights flew.

        Args:
            name: ``C_A``, ``C_N`` or ``C_N_rate`` of the angle of attack, or ``proximity`` of D_prox.
            level: Probability in the band at every point.
            points: Of the grid.
            over: Range of the grid, SI; None: what was flown. Beyond that, the curve is extrapolated.
            distance: D_prox of another canopy, beside the pitch plane; None: the canopy is alone.
            speed: Airspeed over the reference speed, in sea-level air.

        Raises:
            InputError: If the posterior has no term of it.
        """
        told = self._draws("posterior")
        return curve(
            name, told, self._draws("prior") or None, self.ranges, self.knowledge, level, points, over, distance, speed
        )

    @cached_property
    def knowledge(self) -> list[dict[str, Any]]:
        """What the study says that others know, beside the posterior: z-scores, p-value and verdict of each."""
        return agreement(self.spec, self._draws("posterior"))

    @property
    def _priors(self) -> list[Prior]:
        """Priors of the parameters, those of terms that the fit added or left out put right."""
        told = self._json("fit/priors.json") or self._json("priors.json") or []
        return [Prior(**entry) for entry in told]

    @cached_property
    def _history(self) -> list[dict[str, Any]]:
        flights = [f.name for f in self.spec.with_role("identify")]
        own = lessons(self._priors, self._draws("posterior"), flights)
        return [*(self._json(HISTORY) or []), *([own] if own else [])]

    def as_priors(self) -> Priors:
        """This posterior as priors for other flights: a Gaussian with the draws' mean and whole covariance.

        Noise parameters, initial states and disturbances are a flight's own and begin anew.

        Raises:
            InputError: If its parameters are those of populations or of several bodies.

        Example:
            >>> posterior.as_priors().names == posterior.names
            True
        """
        return priors_of(self.spec, self._priors, self._draws("posterior"), self._taught_by)

    @property
    def _taught_by(self) -> list[str]:
        earlier = [name for one in self._json(HISTORY) or [] for name in one["flights"]]
        return [*earlier, *(f.name for f in self.spec.with_role("identify"))]

    def taught(self) -> pd.DataFrame:
        """What each drop taught: standard deviation before and after, shift, information gained [nats].

        Returns:
            A row a drop and parameter; ``attrs["joint"]`` has the gain about all parameters together by drop.

        Example:
            >>> bool((posterior.taught()["gain"] > 0.0).all())
            True
        """
        return taught_table(self._history)

    def update(
        self,
        flights: Study | Flight | Sequence[Flight],
        *,
        noise: NoiseTable | None = None,
        draws: int | None = None,
        chains: int | None = None,
        warmup: int | None = None,
        seed: int | None = None,
        progress: Progress | bool | None = None,
    ) -> Posterior:
        """The posterior after further flights: this one is their prior, as of `as_priors`.

        Its terms stay as they are. Where flights have another vehicle, masses and risers begin anew by the priors of
        their study.

        Args:
            flights: A study, whose flights with the role ``identify`` are fitted; or flights, none of which taught this
                posterior before.
            noise: Noise of channels and latent disturbances; None: that of the flights' study.
            draws: In all; the flights' study's number where None.
            chains: Chains.
            warmup: Warm-up steps of each.
            seed: Of the draws; the flights' study's where None.
            progress: Called with stage, share done and words; True: shown in the terminal.

        Raises:
            InputError: If a flight taught it already, or parameters are not shared by all drops.
            FitError: If no flight of the model follows the records.

        Example:
            >>> tomorrow = posterior.update([next_flight], draws=100, chains=2, warmup=50)
            >>> tomorrow.taught().index.get_level_values("drop").unique().tolist()
            ['low', 'high']
        """
        several = chosen(flights)
        priors = next_priors(self.as_priors(), self.spec, self._taught_by, several)
        spec, made, files = fitted_flights(several, priors, noise, None, progress)
        files = {**files, HISTORY: json.dumps(self._history).encode()}
        spec = sampling(spec, draws, chains, warmup, seed, None)
        return drawn(spec, made, files, progress, Posterior.of_run)

    def proposals(self) -> pd.DataFrame:
        """Terms that the fit's latent forces follow: share of their variance, and how likely that is by chance."""
        return pd.DataFrame(as_rows(proposed_terms(self._flown)))

    def save(self, path: Path | str) -> Path:
        """Write one NetCDF file: the DataTree's groups, and one more with study, records and fits.

        Args:
            path: Such as ``cdt-3-11.posterior.nc``.

        Example:
            >>> path = posterior.save(folder / "drop.posterior.nc")
            >>> bc.Posterior.load(path).names == posterior.names
            True
        """
        path = Path(path)
        said = {"format": ARTEFACT_VERSION, "version": __version__, _SPEC: study_to_plain(self.spec)}
        content = {_SPEC: json.dumps(said).encode(), **{f"file {name}": data for name, data in self.files.items()}}
        held = xr.Dataset(
            {
                f"content_{i}": (f"byte_{i}", np.frombuffer(data, np.uint8), {"name": name})
                for i, (name, data) in enumerate(content.items())
            }
        )
        tree = self.data.copy()
        tree[_GROUP] = xr.DataTree(held)
        write_whole(path, lambda aside: tree.to_netcdf(aside, engine="h5netcdf"))
        return path

    @classmethod
    def load(cls, path: Path | str) -> Posterior:
        """Read a posterior that `save` wrote.

        Raises:
            InputError: If the file is not one, or a later version wrote it.
        """
        path = Path(path)
        wanted = "a posterior written by `Posterior.save` or `bayeschute fit`"
        if not path.is_file():
            raise InputError(Fault(str(path), "no such file", wanted))
        try:
            with xr.open_datatree(path, engine="h5netcdf") as opened:
                tree = opened.load()
            held = tree[_GROUP].to_dataset()
            content = {one.attrs["name"]: one.values.astype(np.uint8).tobytes() for one in held.data_vars.values()}
            said = json.loads(content[_SPEC])
        except (OSError, KeyError, ValueError) as error:
            raise InputError(Fault(str(path), f"a file that can't be read ({error})"[:200], wanted)) from None
        if said.get("format") != ARTEFACT_VERSION:
            got = f"format {said.get('format')} of version {said.get('version')}"
            raise InputError(Fault(str(path), got, f"format {ARTEFACT_VERSION}", "Use the version that wrote it."))
        kept = {name.removeprefix("file "): data for name, data in content.items() if name.startswith("file ")}
        groups_ = {name: node.to_dataset() for name, node in tree.children.items() if name != _GROUP}
        return cls(study_from_plain(said[_SPEC]), xr.DataTree.from_dict(groups_), kept)

    @classmethod
    def of_run(cls, folder: Path | str, study: StudySpec) -> Posterior:
        """The posterior of a finished run.

        Raises:
            InputError: If the run has none.
        """
        folder = Path(folder)
        if not (folder / "posterior.nc").is_file():
            raise InputError(Fault(str(folder), "no posterior.nc", "the folder of a run that was fitted"))
        with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as opened:
            tree = opened.load()
        fitted = {f.name for f in study.with_role("identify")} | {f.name for f in study.with_role("structure")}
        kept = {
            name: data
            for name, data in collected(folder, KEPT).items()
            if not name.startswith("flights/") or name.split("/")[1].split(".")[0] in fitted
        }
        return cls(_fitted_only(study), tree, kept)

    def predict(self, flight: Flight, draws: int | None = None, seed: int | None = None) -> Forecast:
        """Draws of a flight's quantities: of another one, or of one that was fitted.

        Another flight is known by the opening of its record (its first 5 s) and by its wind; beyond that, disturbances
        follow their process. It may have a vehicle, a payload and a number of canopies of its own.

        Args:
            flight: From a study, or made of a record or of a virtual drop.
            draws: How many; the study's number where None.
            seed: Seed; the study's where None.

        Raises:
            InputError: If another flight has the name of one that was fitted.

        Example:
            >>> forecast = posterior.predict(study.flights[0], draws=64)
            >>> forecast.draws.sizes["draw"]
            64
        """
        spec = self.spec if seed is None else replace(self.spec, seed=seed)
        if draws is not None:
            spec = replace(spec, predict=spec.predict.model_copy(update={"draws": int(draws)}))
        known = {f.name: f for f in spec.flights}
        asked = flight.spec
        own = known.get(asked.name)
        if own is not None and replace(asked, roles=own.roles, vehicle=own.vehicle) != own:
            do = "Give it another name: `flight.changed(name=...)`."
            raise InputError(Fault(f"flight {asked.name}", "the name of a fitted flight", "a name of its own", do))
        if own is None:
            vehicle = flight.vehicle if flight.vehicle != self.spec.vehicle else None
            asked = replace(asked, roles=("predict",), vehicle=vehicle)
            spec = replace(spec, flights=(*spec.flights, asked))
        with workspace(spec, self.files) as job:
            if own is None:
                ingest_flight(job, asked, flight.raw)
            foreseen = widened(forecast_flight(job, own or asked), widening(job))
            recorded = recorded_quantities(job, foreseen.flight, foreseen.record)
        return Forecast.of(foreseen, recorded, self._json("checks.json"))

    def __repr__(self) -> str:
        """Flights, parameters and draws."""
        sizes = self.data["posterior"].sizes
        names = ", ".join(f.name for f in self.spec.with_role("identify"))
        return f"Posterior of {names}: {len(self.names)} parameters, {sizes['chain']} chains of {sizes['draw']} draws"

    def _repr_html_(self) -> str:
        """Means and intervals as a table."""
        rows = []
        for name in self.names:
            low, middle, high = (html.number(float(q)) for q in np.quantile(self[name].values, (0.05, 0.5, 0.95)))
            rows.append((name, middle, f"{low} to {high}", self[name].attrs.get("units", "1")))
        missed = ", ".join(self.checks().query("passed == False").index) if "checks.json" in self.files else ""
        note = f"checks missed: {missed}" if missed else "all checks passed"
        return html.table(repr(self), ("parameter", "median", "central 90 %", "unit"), rows, note)

    @cached_property
    def marginals(self) -> tuple[Any, ...]:
        """The marginal posteriors that were sampled, one per set of flights; see `numpyro_model`."""
        with workspace(self.spec, self.files) as job:
            return tuple((load_fit(job, group).marginal, group.priors) for group in groups(job))


def _fitted_only(study: StudySpec) -> StudySpec:
    """A study without what was only predicted, and without requirements."""
    kept = tuple(f for f in study.flights if {"identify", "structure"} & set(f.roles))
    return replace(study, flights=kept, requirements=())


@dataclass(frozen=True)
class Probability:
    """P(a requirement is met), and how far the number of draws leaves it open.

    Attributes:
        met: Share of the draws that meet it; failed simulations count as not met.
        low: Lower end of the Clopper-Pearson interval.
        high: Upper end.
        confidence: Of that interval, two-sided.
        draws: How many draws.
        failed: Simulations that failed.

    Example:
        >>> found = forecast.probability("descent_rate", at_most="100 m/s")
        >>> found.met
        1.0
    """

    met: float
    low: float
    high: float
    confidence: float
    draws: int
    failed: int


@dataclass(frozen=True, eq=False, repr=False)
class Forecast:
    """Draws of a flight's quantities over time.

    Attributes:
        name: The flight.
        draws: Quantities with dims (draw, time), units in the attributes; NaN where a simulation failed.
        held_out: Samples that the fit did not see (time,).
        record: Quantities as the record has them, (time,) each; empty without a record.
        truth: Truth of a virtual drop; None of a measured flight.
        shares: Share of variance by quantity and source.
        independent: How many independent draws these are worth.

    Example:
        >>> band = forecast.band("descent_rate", 0.9)
        >>> bool((band["low"] < band["high"]).all())
        True
    """

    name: str
    draws: xr.Dataset
    held_out: NDArray[np.bool_]
    record: Mapping[str, Array]
    truth: xr.Dataset | None
    shares: Mapping[str, Mapping[str, float]]
    independent: int

    @classmethod
    def of(cls, foreseen: Any, recorded: Mapping[str, Array], checks: Mapping[str, Any]) -> Forecast:
        """From what the stages `predict` and `check` of a run make."""
        one = foreseen.prediction
        values = {name: (("draw", "time"), x, {"units": bands.UNITS[name]}) for name, x in one.draws.items()}
        made = xr.Dataset(values, coords={"time": ("time", foreseen.time, {"units": "s"})})
        made.attrs = {"failed": one.failed, "flight": foreseen.flight.name}
        independent = int(min(*checks["ess_bulk"].values(), made.sizes["draw"]))  # as the stage `risk` counts
        return cls(foreseen.flight.name, made, foreseen.held_out, recorded, foreseen.truth, one.shares, independent)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(map(str, self.draws.data_vars))

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Samples that are judged: those held out, all where none is."""
        return self.held_out if self.held_out.any() else np.ones(self.held_out.size, bool)

    def _values(self, quantity: str) -> Array:
        if quantity not in self.draws:
            raise InputError(Fault("quantity", repr(quantity), f"one of {', '.join(self.quantities)}"))
        values: Array = self.draws[quantity].values
        return values

    def statistic(self, quantity: str, statistic: str = "mean") -> xr.DataArray:
        """A statistic of a quantity over the samples that were not seen, one value a draw.

        Args:
            quantity: Its name.
            statistic: ``mean``, ``maximum`` or ``final``.
        """
        if statistic not in REDUCTIONS:
            raise InputError(Fault("statistic", repr(statistic), f"one of {', '.join(REDUCTIONS)}"))
        values = REDUCTIONS[statistic](self._values(quantity)[:, self.counted])
        return xr.DataArray(values, dims="draw", attrs=self.draws[quantity].attrs, name=f"{statistic} {quantity}")

    def band(self, quantity: str, level: float = 0.9) -> xr.Dataset:
        """Central band of a quantity.

        Args:
            quantity: Its name.
            level: Probability in the band [1].

        Returns:
            ``low``, ``median`` and ``high`` over time.
        """
        if not 0.0 < level < 1.0:
            raise InputError(Fault("level", repr(level), "a probability between 0 and 1"))
        shares = (0.5 - 0.5 * level, 0.5, 0.5 + 0.5 * level)
        unit = self.draws[quantity].attrs if quantity in self.draws else {}
        rows = zip(("low", "median", "high"), bands.quantiles(self._values(quantity), shares), strict=True)
        return xr.Dataset({name: ("time", row, unit) for name, row in rows}, coords={"time": self.draws["time"]})

    def probability(
        self,
        quantity: str,
        *,
        statistic: str = "mean",
        at_most: str | float | None = None,
        at_least: str | float | None = None,
        confidence: float = 0.9,
    ) -> Probability:
        """P(a statistic of a quantity over the flight keeps to a limit).

        Args:
            quantity: Its name.
            statistic: ``mean``, ``maximum`` or ``final`` over the samples that were not seen.
            at_most: Upper limit, such as ``"33 ft/s"`` or a number in SI; this or `at_least`.
            at_least: Lower limit.
            confidence: Of the interval that the number of draws leaves.
        """
        samples, unit = self.statistic(quantity, statistic).values, self.draws[quantity].attrs["units"]
        most, least = (to_si(limit, unit) if isinstance(limit, str) else limit for limit in (at_most, at_least))
        made = requirement_check(
            samples, name=f"{statistic} {quantity}", quantity=quantity, unit=unit,
            at_most=most, at_least=least, confidence=confidence, independent=self.independent,
        )  # fmt: skip
        low, high = made["simulation_low"], made["simulation_high"]
        return Probability(made["probability_met"], low, high, confidence, made["draws"], made["failed"])

    def check(self, levels: Sequence[float] = (0.5, 0.9)) -> pd.DataFrame:
        """How the bands hold what was recorded, and the truth where that is known, over the samples not seen.

        Recorded values hold the sensors' noise, the bands do not.

        Returns:
            A row per quantity and reference: share of samples inside each band.

        Raises:
            InputError: If there is neither record nor truth.
        """
        truth = {} if self.truth is None else {q: self.truth[q].values for q in self.quantities if q in self.truth}
        rows = []
        for kind, reference in (("record", self.record), ("truth", truth)):
            for name in self.quantities:
                if name not in reference:
                    continue
                row: dict[str, Any] = {"quantity": name, "reference": kind}
                for level in levels:
                    one = self.band(name, level)
                    known = np.isfinite(reference[name]) & np.isfinite(one["low"].values) & self.counted
                    inside = (reference[name] >= one["low"].values) & (reference[name] <= one["high"].values)
                    row[f"inside {100 * level:g} %"] = float(inside[known].mean()) if known.any() else np.nan
                rows.append(row)
        if not rows:
            raise InputError(Fault(f"forecast of {self.name}", "no record", "a flight with a record to check by"))
        return pd.DataFrame(rows)

    def to_dataset(self) -> xr.Dataset:
        """Quantiles with record and truth, as ``predictions.nc`` of a run has them."""
        draws = {name: self.draws[name].values for name in self.quantities}
        last = np.full((self.draws.sizes["draw"], 3), np.nan)
        one = bands.Prediction(self.draws["time"].values, draws, last, int(self.draws.attrs["failed"]), self.shares)
        role = "predict" if self.held_out.any() else "identify"
        return bands.dataset(one, one.time, self.quantities, self.truth, self.record, self.held_out, role)

    def plot(self, limits: Mapping[str, float] | None = None) -> Figure:
        """Bands over time with record and truth, a panel per quantity.

        Args:
            limits: Limits by quantity (SI), drawn as lines.
        """
        from bayeschute.report.figures.record_figures import band_figure

        return band_figure(self.to_dataset(), limits)

    def __repr__(self) -> str:
        """Flight, quantities and draws."""
        sizes = self.draws.sizes
        told = f"{sizes['draw']} draws of {', '.join(self.quantities)} at {sizes['time']} times"
        return f"Forecast of {self.name}: {told}, {self.draws.attrs['failed']} failed"

    def _repr_html_(self) -> str:
        """Medians and 90 % bands of the mean over the flight, as a table."""
        rows = []
        for name in self.quantities:
            low, middle, high = (html.number(float(q)) for q in self.statistic(name).quantile((0.05, 0.5, 0.95)))
            rows.append((name, middle, f"{low} to {high}", self.draws[name].attrs["units"]))
        return html.table(repr(self), ("mean over the flight", "median", "central 90 %", "unit"), rows)


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run in a folder, finished or as far as it went.

    Attributes:
        folder: The folder.
        study: The study as it ran.

    Example:
        >>> run = bc.Run(folder / "run", study)
        >>> run, run.level
        (Run('...run': not finished), 'not checked')
    """

    folder: Path
    study: Study

    @property
    def summary(self) -> dict[str, Any]:
        """summary.json; empty where the last stage has not run."""
        path = self.folder / "summary.json"
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}

    @property
    def level(self) -> str:
        """Level of trust in the intervals, such as ``self-consistent``; ``not checked`` where no label was written."""
        return str(self.summary.get("claim", {}).get("level", "not checked"))

    @property
    def predictive_checks(self) -> pd.DataFrame:
        """Predictive checks of the fitted records, the smallest p-value first; empty before the stage ``check``."""
        path = self.folder / "predictive.json"
        rows = json.loads(path.read_text(encoding="utf-8"))["checks"] if path.is_file() else []
        columns = ["flight", "what", "statistic", "value", "expected", "p"]
        return pd.DataFrame(rows, columns=columns).sort_values("p", ignore_index=True)

    @cached_property
    def posterior(self) -> Posterior:
        """The posterior."""
        return Posterior.of_run(self.folder, self.study.spec)

    @cached_property
    def forecasts(self) -> Mapping[str, Forecast]:
        """Forecasts of the flights that were fitted or predicted, drawn anew by name."""
        return _Forecasts(self)

    def report(self) -> Path:
        """Build report.html from the results; returns its path."""
        from bayeschute.report.page import build_report

        return build_report(self.folder)

    def __repr__(self) -> str:
        """Folder and label."""
        return f"Run({str(self.folder)!r}: {self.summary.get('label', 'not finished')})"


class _Forecasts(Mapping[str, Forecast]):
    """Forecasts of a run, made when asked for."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._made: dict[str, Forecast] = {}

    def __getitem__(self, name: str) -> Forecast:
        if name not in self._made:
            study = self._run.study.spec
            flight = next((f for f in study.flights if f.name == name and f.name in set(self)), None)
            if flight is None:
                raise KeyError(name)
            by_name = {f"flights/{path.name}": path.read_bytes() for path in (self._run.folder / "flights").iterdir()}
            with workspace(study, {**collected(self._run.folder), **by_name}) as job:
                foreseen = widened(forecast_flight(job, flight), widening(job))
                recorded = recorded_quantities(job, flight, foreseen.record)
                self._made[name] = Forecast.of(foreseen, recorded, job.load("checks.json"))
        return self._made[name]

    def __iter__(self) -> Any:
        return iter([f.name for f in self._run.study.spec.flights if {"identify", "predict"} & set(f.roles)])

    def __len__(self) -> int:
        return len(list(iter(self)))
