"""`Posterior`: draws of the parameters given the flights, and questions about them and about other flights."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayeschute.api import html
from bayeschute.api.beliefs import Priors
from bayeschute.api.drop_by_drop import HISTORY, next_priors, priors_of, taught_table
from bayeschute.api.fitting import chosen, drawn, fitted_flights, sampling
from bayeschute.api.flight import Flight
from bayeschute.api.forecast import Forecast, forecast
from bayeschute.api.inputs import Study
from bayeschute.api.landing.landing_verb import Winds, campaign_of, land, source_of
from bayeschute.api.landing.landings import Landings
from bayeschute.api.posterior_file import posterior_of_run, read_posterior, write_posterior
from bayeschute.api.views.curve import Curve, curve
from bayeschute.api.workspace import Files, workspace
from bayeschute.calibration.label import Claim, without_level
from bayeschute.core.errors import Fault, InputError
from bayeschute.likelihood.priors import Prior, read_priors, saturation_of
from bayeschute.posterior.assess.alternatives import Score
from bayeschute.posterior.assess.flight_groups import for_loo_pit
from bayeschute.prediction.predictive_checks import Check
from bayeschute.report.check_words import wanted
from bayeschute.report.wording import counted, shown_unit
from bayeschute.study.aerodynamics.agreement import agreement
from bayeschute.study.aerodynamics.flown import flown, ranges
from bayeschute.study.aerodynamics.term_proposals import as_rows, proposed_terms
from bayeschute.study.assembly.fits import groups, load_fit
from bayeschute.study.evidence.calibration_status import status
from bayeschute.study.evidence.record_misfit import NAME as PREDICTIVE
from bayeschute.study.job import Progress
from bayeschute.study.run.stage_report import what_flights_taught
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.study import Study as StudySpec

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Posterior:
    """Draws of the parameters given the flights, with what it takes to ask them about another flight.

    A posterior needs no folder: `save` writes one NetCDF file that ArviZ reads, and `load` reads it anywhere.

    Attributes:
        spec: The study that was fitted, with the fitted flights.
        data: ArviZ DataTree; its groups are those of `posterior.assess.data_tree`.
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

    def _ipython_key_completions_(self) -> list[str]:
        """Names of the parameters, for tab completion."""
        return list(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(map(str, self.data["posterior"].data_vars))

    def summary(self, **options: Any) -> pd.DataFrame:
        """Mean, standard deviation, intervals and diagnostics of every parameter, with its unit.

        R-hat and effective draws of the report are those of the sampler's own draws, to which the uncertainty of the
        noise parameters was not added yet: ``summary(group="conditional")`` has them.

        Args:
            **options: Of `arviz_stats.summary`, which makes the other columns: 90 % intervals, and four significant
                digits, unless ``ci_prob`` and ``round_to`` say otherwise.

        Example:
            >>> posterior.summary()["unit"].to_list()
            ['m^2/kg']
        """
        import arviz_stats

        told = arviz_stats.summary(self.data, **({"ci_prob": 0.9, "round_to": "none"} | options))
        units = {name: self[name].attrs.get("units", "1") for name in self.names}
        if isinstance(told, pd.DataFrame) and "round_to" not in options:
            told = told.map(lambda x: float(f"{x:.4g}") if isinstance(x, float) else x)
        if isinstance(told, pd.DataFrame) and {*told.index} <= {*units}:
            told.insert(0, "unit", [units[name] for name in told.index])
        return told

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
        """Checks of fit and draws.

        Returns:
            A row for each: ``passed``, ``value``, ``bound``, ``detail`` (what it measures), ``wanted`` (the bound with
            its sense, such as "at most 1.01"). Empty before the checks were made.
        """
        return pd.DataFrame.from_dict(
            {n: one | {"wanted": wanted(n, one["bound"])} for n, one in self._checks.items()}, "index"
        )

    @property
    def _checks(self) -> dict[str, Any]:
        """Checks that were stored; none before they were made."""
        return dict(self._json("checks.json").get("checks", {}))

    def identifiability(self) -> pd.DataFrame:
        """What the records tell of each parameter beyond its prior.

        Returns:
            A row per parameter, columns as in ``identifiability.json`` (`ParameterIdentifiability`): ``contraction``,
            the share of the prior's variance that the data remove (NaN of posteriors stored before it was),
            ``diagnosis`` in words, and others. Empty before the analysis.

        Example:
            >>> bool(posterior.identifiability()["contraction"].iloc[0] > 0.9)
            True
        """
        told = self._json("identifiability.json")
        rows = {name: entry for group in told.values() for name, entry in group["parameters"].items()}
        table = pd.DataFrame.from_dict(rows, orient="index")
        return table if table.empty or "contraction" in table else table.assign(contraction=np.nan)

    def predictive_checks(self) -> pd.DataFrame:
        """Predictive checks of the fitted records, the smallest p-value first; empty before they were made.

        Returns:
            Columns ``flight``; ``statistic`` of ``what``; its ``value`` and what is ``expected`` [``unit``]; ``p``;
            ``matters``: whether a small one counts.

        Example:
            >>> bool(posterior.predictive_checks()["p"].is_monotonic_increasing)
            True
        """
        rows = self._json(PREDICTIVE).get("checks", [])
        return pd.DataFrame(rows, columns=[*Check._fields]).sort_values("p", ignore_index=True)

    def possible_errors(self) -> pd.DataFrame:
        """Errors of records and vehicle that the fit was tested for by name, and what to do about each.

        Returns:
            Columns ``flight``; ``what`` the error is of; its size ``estimate`` and ``se`` [``unit``], each error by
            itself (score test); ``moves``: by how many posterior standard deviations it would move the parameter that
            it moves most; ``p``; ``matters``: whether a small p-value counts; ``do``. Empty of descents.

        Example:
            >>> list(posterior.possible_errors().columns[:4])
            ['flight', 'what', 'unit', 'estimate']
        """
        rows = self._json(PREDICTIVE).get("errors", [])
        return pd.DataFrame(rows, columns=["flight", *Score._fields, "p", "matters", "do"])

    @property
    def passed(self) -> bool:
        """Whether all checks passed; False before they were made."""
        found = self.checks()
        return not found.empty and bool(found["passed"].all())

    @property
    def failed_checks(self) -> tuple[str, ...]:
        """Names of the checks that failed: with one or more, nothing that follows has a level of trust."""
        found = self.checks()
        return () if found.empty else tuple(found.index[~found["passed"].astype(bool)])

    @cached_property
    def trust(self) -> Claim:
        """What its intervals may claim: level of trust, the evidence for it, what is lacking, what contradicts them.

        By its own checks, and by the replicates that are stored with the program for its study's configuration. Flights
        that were held out and predicted count in the label of a run (`Run`), not here.

        Example:
            >>> posterior.trust.level.words
            'not checked'
            >>> any("calibration" in reason for reason in posterior.trust.lacking)
            True
        """
        with workspace(self.spec, self.files) as job:
            return status(job, self._checks, {}).claim

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
        told, before = self._draws("posterior"), self._draws("prior") or None
        known, saturation = self.knowledge, saturation_of(self._priors)
        return curve(name, told, before, self.ranges, known, level, points, over, distance, speed, saturation)

    @cached_property
    def knowledge(self) -> list[dict[str, Any]]:
        """What the study says that others know, beside the posterior: z-scores, p-value and verdict of each."""
        return agreement(self.spec, self._draws("posterior"), saturation_of(self._priors))

    @property
    def _priors(self) -> list[Prior]:
        """Priors of the parameters, those of terms that the fit added or left out put right."""
        told = self._json("fit/priors.json") or self._json("priors.json") or []
        return read_priors(told)

    @cached_property
    def _history(self) -> list[dict[str, Any]]:
        flights = [f.name for f in self.spec.with_role("identify")]
        own = what_flights_taught(self._priors, self._draws("posterior"), flights)
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
        """Information gained from each drop [nats]: also the standard deviation before and after it, and the shift.

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
            flights: A study, whose flights with the role ``identify`` are fitted; or flights, none of which this
                posterior contains.
            noise: Noise of channels and latent disturbances; None: that of the flights' study.
            draws: In all; the flights' study's number where None.
            chains: Chains.
            warmup: Warm-up steps of each.
            seed: Of the draws; the flights' study's where None.
            progress: Called with stage, share done and words; True: shown in the terminal.

        Raises:
            InputError: If the posterior contains a flight already, or parameters are not shared by all drops.
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
        return write_posterior(Path(path), self.spec, self.data, self.files)

    @classmethod
    def load(cls, path: Path | str) -> Posterior:
        """Read a posterior that `save` wrote, or that of a finished run.

        Args:
            path: A file of `save` or `bayeschute fit`, or the folder of a run that keeps its study.

        Raises:
            InputError: If the file is not one, or a later version wrote it; if the run was not fitted.
        """
        return cls(*read_posterior(Path(path)))

    @classmethod
    def of_run(cls, folder: Path | str, study: StudySpec) -> Posterior:
        """The posterior of a finished run.

        Raises:
            InputError: If the run has none.
        """
        return cls(*posterior_of_run(Path(folder), study))

    def predict(
        self,
        flight: Flight,
        draws: int | None = None,
        seed: int | None = None,
        *,
        disturbance_log_sd: float | None = None,
        like: str | None = None,
    ) -> Forecast:
        """Draws of a flight's quantities: of another one, or of one that was fitted.

        Another flight is known by the opening of its record (its first 5 s) and by its wind; beyond that, disturbances
        follow their process. It may have a vehicle, a payload and a number of canopies of its own.

        Args:
            flight: From a study, or made of a record or of a virtual drop.
            draws: How many, at most as many as the posterior has; the study's number where None.
            seed: Seed; the study's where None.
            disturbance_log_sd: How much rougher or calmer than in the fit the air beyond the data may be: standard
                deviation of the logarithm of a factor, 0 to 3 (0.7: within a factor of two, two times in three); the
                study's where None.
            like: Where each fitted flight has parameters of its own (descents, ``vary``): the one whose body flies.

        Raises:
            InputError: If another flight has the name of one that was fitted, an argument is out of range, or it isn't
                said which of several bodies flies.

        Example:
            >>> forecast = posterior.predict(study.flights[0], draws=64)
            >>> forecast.draws.sizes["draw"]
            64
        """
        spec, most = self.spec, draws_held(self)
        if draws is not None and draws > most:
            do = "Predict with fewer, or sample more: bc.sample(..., draws=...), or [sampler] draws."
            raise InputError(Fault("draws", f"{draws}", f"at most {most}, draws of the posterior", do))
        if disturbance_log_sd is not None:
            if not 0.0 <= disturbance_log_sd <= 3.0:
                raise InputError(Fault("disturbance_log_sd", repr(disturbance_log_sd), "a number from 0 to 3"))
            table = spec.predict.model_copy(update={"disturbance_log_sd": float(disturbance_log_sd)})
            spec = replace(spec, predict=table)
        made = forecast(spec, self.files, flight, draws, seed, like)
        failed = tuple(dict.fromkeys((*self.failed_checks, *made.failed_checks)))
        return replace(made, failed_checks=failed, level=self.trust.words)

    def land(
        self,
        vehicle: Vehicle | Flight | None = None,
        winds: Winds = None,
        draws: int = 100_000,
        *,
        start: Mapping[str, Any] | None = None,
        seed: int | None = None,
        workers: int = 1,
        folder: Path | str | None = None,
        progress: Progress | None = None,
        **tables: Any,
    ) -> Landings:
        """Landings to the ground: joint draws of parameters, winds, gusts, starts and canopies.

        Args:
            vehicle: That lands; a flight: its vehicle with its own payload, through its own wind profile unless `winds`
                are given; None: that of the posterior.
            winds: Winds by altitude from `wind_profile`, one or many, each as likely as any other; or their statistics
                from `wind_climatology`; or the entries of ``[wind]`` of a campaign file. None: calm, with gusts as the
                posterior knows them.
            draws: Landings; they take 200 draws of the parameters in turn, unless `tables` says ``draws``.
            start: Entries of ``[start]`` of a campaign file that differ from a steady descent from 1200 m.
            seed: Of all random numbers; the study's where None.
            workers: Local processes; 1: this one.
            folder: Where batches are kept as they come, so that the same call goes on after it was stopped.
            progress: Called with a name, the share done and words.
            **tables: Other entries of a campaign file, such as ``ground={"altitude": "1200 m"}``; with a
                ``requirement``, landings end as soon as it is decided.

        Raises:
            InputError: With every fault, or if the posterior is of a point mass.
        """
        if isinstance(vehicle, Flight):
            own = vehicle.spec
            winds = own.wind_profile if winds is None else winds
            tables |= {"capsule_mass": f"{own.capsule_mass!r} kg"} if own.capsule_mass is not None else {}
            vehicle = vehicle.vehicle if vehicle.vehicle != self.spec.vehicle else None
        campaign = campaign_of(vehicle, winds, draws, start, self.spec.seed if seed is None else seed, **tables)
        source = source_of(
            campaign, self.spec, self.files, self.failed_checks, workers, progress=progress, level=self.trust.words
        )
        return land(source, None if folder is None else Path(folder))

    def __repr__(self) -> str:
        """Flights, parameters and draws."""
        sizes = self.data["posterior"].sizes
        names = ", ".join(f.name for f in self.spec.with_role("identify"))
        of = counted(len(self.names), "parameter")
        checked = without_level(self.failed_checks) or ("all checks passed" if self.passed else "not checked")
        return f"Posterior of {names}: {of}, {sizes['chain']} chains of {sizes['draw']} draws; {checked}"

    def _repr_html_(self) -> str:
        """Medians and intervals as a table, in the units of the report."""
        rows = []
        for name in self.names:
            scale, unit = shown_unit(self[name].attrs.get("units", "1"))
            ends = scale * np.quantile(self[name].values, (0.05, 0.5, 0.95))
            low, middle, high = (html.number(float(q)) for q in ends)
            rows.append((name, middle, f"{low} to {high}", unit or "1"))
        return html.table(repr(self), ("parameter", "median", "central 90 %", "unit"), rows)

    @cached_property
    def marginals(self) -> tuple[Any, ...]:
        """The marginal posteriors that were sampled, one per set of flights; see `numpyro_model`."""
        with workspace(self.spec, self.files) as job:
            return tuple((load_fit(job, group).marginal, group.priors) for group in groups(job))


def draws_held(posterior: Posterior) -> int:
    """Draws of a posterior, all chains together."""
    sizes = posterior.data["posterior"].sizes
    return int(sizes["chain"] * sizes["draw"])
