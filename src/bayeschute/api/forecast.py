"""`Forecast`: draws of a flight's quantities over time, and probabilities of limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayeschute.api import html
from bayeschute.api.flight import Flight
from bayeschute.api.quantity import central, si
from bayeschute.api.workspace import Files, workspace
from bayeschute.calibration.label import caveat, lost_simulations
from bayeschute.core.errors import Fault, InputError
from bayeschute.prediction import bands
from bayeschute.prediction.flight_statistics import REDUCTIONS
from bayeschute.prediction.held_shares import p_value, shares_inside
from bayeschute.prediction.requirement import requirement_check
from bayeschute.report.wording import shown_unit
from bayeschute.study.evidence.recalibrate import widening
from bayeschute.study.job import Job, load_flight
from bayeschute.study.run.forecasts import FlightForecast, forecast_flight, stored_forecast, when_lost, widened
from bayeschute.study.run.stage_data import ingest_flight, read_and_judge
from bayeschute.study.run.stage_predict import channel_noise, recorded_quantities
from bayeschute.study.study import Flight as FlightSpec
from bayeschute.study.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
_RENAME = "Give it another name: `flight.changed(name=...)`."


@dataclass(frozen=True, repr=False)
class Probability:
    """P(a requirement is met), and how far the number of draws leaves it open.

    Attributes:
        met: Share of the draws that meet it; failed simulations count as not met.
        low: Lower end of the Clopper-Pearson interval.
        high: Upper end.
        confidence: Of that interval, two-sided.
        draws: How many draws.
        failed: Simulations that failed.
        failed_checks: Of the forecast: with one or more, the number has no level of trust.
        level: Level of trust of the posterior, as `Run.level` has it; empty: not asked.

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
    failed_checks: tuple[str, ...] = ()
    level: str = ""

    def __repr__(self) -> str:
        """On one line, to as many digits as the draws tell."""
        failed = f", {self.failed:,} of them failed to simulate and counted as not met" if self.failed else ""
        between = f"{self.low:.3f} to {self.high:.3f} for the number of draws ({100.0 * self.confidence:.0f} %)"
        told = f"P(met) = {self.met:.3f}, {between}, {self.draws:,} draws{failed}"
        return "; ".join(filter(None, (told, caveat(self.failed_checks, self.level))))

    def _repr_html_(self) -> str:
        """The same as a table."""
        limits = f"{self.low:.3f} to {self.high:.3f} ({100.0 * self.confidence:.0f} %)"
        rows = [("P(met)", f"{self.met:.3f}"), ("for the number of draws alone", limits)]
        rows.append(("draws, of them failed to simulate", f"{self.draws:,}, {self.failed:,}"))
        return html.table("Probability", ("of", "told"), rows, caveat(self.failed_checks, self.level))


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
        recorded_with: Noise of the instrument, by quantity that one channel records: standard deviations of the white
            and the correlated part [unit of the quantity], time constant of the latter [s].
        seed: Of that noise in `as_recorded`.
        failed_checks: Of the posterior, and ``bands`` where too many of these simulations failed: with one or more, the
            bands have no level of trust.
        level: Level of trust of the posterior, as `Run.level` has it; empty: not asked.

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
    recorded_with: Mapping[str, tuple[float, float, float]]
    seed: int
    failed_checks: tuple[str, ...] = ()
    level: str = ""

    @classmethod
    def of(cls, job: Job, foreseen: FlightForecast) -> Forecast:
        """From what the stages `predict` and `check` of a run make."""
        one, recorded = foreseen.prediction, recorded_quantities(job, foreseen.flight, foreseen.record)
        noise = {name: n for name in one.draws if (n := channel_noise(job, foreseen.hyper, name)) is not None}
        alone = foreseen.record.sizes.get("canopy") == 1  # one canopy has no flyout angle
        values = {
            name: (("draw", "time"), x, {"units": bands.UNITS[name]})
            for name, x in one.draws.items()
            if not (alone and name == "flyout_angle")
        }
        made = xr.Dataset(values, coords={"time": ("time", foreseen.time, {"units": "s"})})
        lost = lost_simulations(foreseen.flight.name, one.failed, made.sizes["draw"])
        made.attrs = {"failed": one.failed, "flight": foreseen.flight.name}
        made.attrs["lost"] = "; ".join(filter(None, [lost, when_lost(job)])) if lost else ""
        checks = job.load("checks.json")
        independent = int(min(*checks["ess_bulk"].values(), made.sizes["draw"]))  # as the stage `risk` counts
        failed = tuple(name for name, check in checks["checks"].items() if not check["passed"])
        if lost:
            failed = (*failed, "bands")
        return cls(
            foreseen.flight.name, made, foreseen.held_out, recorded, foreseen.truth, one.shares, independent, noise,
            foreseen.seed, failed,
        )  # fmt: skip

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(map(str, self.draws.data_vars))

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Samples that are judged: those held out, all where none is."""
        return self.held_out if self.held_out.any() else np.ones(self.held_out.size, bool)

    @property
    def _prediction(self) -> bands.Prediction:
        draws = {name: self.draws[name].values for name in self.quantities}
        last = np.full((self.draws.sizes["draw"], 3), np.nan)
        return bands.Prediction(self.draws["time"].values, draws, last, int(self.draws.attrs["failed"]), self.shares)

    def _values(self, quantity: str) -> Array:
        if quantity not in self.draws:
            raise InputError(Fault("quantity", repr(quantity), f"one of {', '.join(self.quantities)}"))
        values: Array = self.draws[quantity].values
        return values

    def between(self, start: str | float | None = None, end: str | float | None = None) -> Forecast:
        """The same draws over a part of the time, for statistics, probabilities and checks of that part.

        Args:
            start: On the clock of the record, such as ``"120 s"`` or a number in s; the first sample where None.
            end: Likewise, included; the last sample where None.

        Raises:
            InputError: If fewer than two samples lie between.

        Example:
            >>> last = forecast.between(forecast.draws["time"].values[-1] - 10.0)
            >>> bool(last.statistic("descent_rate").median() < 100.0)
            True
        """
        time = self.draws["time"].values
        first, last = (
            float(time[place]) if given is None else si(name, given, "s")
            for name, given, place in (("start", start, 0), ("end", end, -1))
        )
        some = (time >= first) & (time <= last)
        if some.sum() < 2:
            wanted = f"two samples or more of {time[0]:g} to {time[-1]:g} s between them"
            raise InputError(Fault(f"forecast of {self.name}", f"start={start!r}, end={end!r}", wanted))
        return replace(
            self,
            draws=self.draws.isel(time=some),
            held_out=self.held_out[some],
            record={name: row[some] for name, row in self.record.items()},
            truth=None if self.truth is None else self.truth.isel(time=some),
        )

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

    def summary(self, statistic: str = "mean", level: float = 0.9) -> pd.DataFrame:
        """A statistic of every quantity: median and central interval over the draws.

        Args:
            statistic: ``mean``, ``maximum`` or ``final``, over the samples that were not seen.
            level: Probability in the interval [1].

        Returns:
            A row per quantity, indexed by it: ``low``, ``median``, ``high``, ``unit``; angles in deg, as in figures.

        Example:
            >>> forecast.summary("maximum").loc["descent_rate", "unit"]
            'm/s'
        """
        rows = {}
        for name in self.quantities:
            scale, unit = shown_unit(self.draws[name].attrs["units"])
            low, middle, high = scale * _central(self.statistic(name, statistic).values[:, None], level)[:, 0]
            rows[name] = {"low": low, "median": middle, "high": high, "unit": unit or "1"}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("quantity")

    def band(self, quantity: str, level: float = 0.9) -> xr.Dataset:
        """Central band of a quantity.

        Args:
            quantity: Its name.
            level: Probability in the band [1].

        Returns:
            ``low``, ``median`` and ``high`` over time, in the SI unit that ``attrs["units"]`` states.
        """
        unit = self.draws[quantity].attrs if quantity in self.draws else {}
        rows = zip(("low", "median", "high"), _central(self._values(quantity), level), strict=True)
        made = {name: ("time", row, unit) for name, row in rows}
        return xr.Dataset(made, {"time": self.draws["time"]}, {"quantity": quantity, "level": level} | unit)

    def probability(
        self,
        quantity: str,
        statistic: str = "mean",
        *,
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

        Raises:
            InputError: If quantity, statistic or limit are none that can be.
        """
        if (at_most is None) == (at_least is None):
            got = "no limit" if at_most is None else f"at_most={at_most!r} and at_least={at_least!r}"
            wanted = "at_most or at_least, exactly one of the two, such as at_most='33 ft/s'"
            raise InputError(Fault(f"probability of {quantity}", got, wanted))
        samples, unit = self.statistic(quantity, statistic).values, self.draws[quantity].attrs["units"]
        most = None if at_most is None else si("at_most", at_most, unit)
        least = None if at_least is None else si("at_least", at_least, unit)
        made = requirement_check(
            samples, name=f"{statistic} {quantity}", quantity=quantity, unit=unit,
            at_most=most, at_least=least, confidence=confidence, independent=self.independent,
        )  # fmt: skip
        low, high = made["simulation_low"], made["simulation_high"]
        return Probability(
            made["probability_met"],
            low,
            high,
            confidence,
            made["draws"],
            made["failed"],
            self.failed_checks,
            self.level,
        )

    def as_recorded(self, quantity: str) -> xr.DataArray:
        """Draws of a quantity as its instrument would record it: the channel's noise added, (draw, time).

        A quantity that several channels give together, such as the swing angle, has no noise of its own: its draws are
        returned as they are.

        Example:
            >>> seen = forecast.as_recorded("descent_rate")
            >>> bool(seen.std() > forecast.draws["descent_rate"].std())
            True
        """
        self._values(quantity)  # refuses what was not predicted
        noise = self.recorded_with.get(quantity)
        return self.draws[quantity].copy(data=bands.recorded_draws(self._prediction, quantity, noise, self.seed))

    def check(self, levels: Sequence[float] = (0.5, 0.9)) -> pd.DataFrame:
        """How the bands hold what was recorded, and the truth where that is known, over the samples not seen.

        The truth is compared with the draws, the record with draws `as_recorded`, as ``coverage.json`` of a run does. A
        quantity that several channels give together is compared where the record was not fitted only: its own noise
        is not known, and exceeds the narrow band of a fitted flight.

        Returns:
            A row per quantity and reference: how many samples, the share of them inside each band, and ``p``, how often
            a flight drawn from this forecast is no more of the time inside the widest of these bands. A swing that is
            once out of phase stays so for long: the share of one flight scatters widely, and ``p`` tells whether it is
            too small. Not a number without draws. ``passed``: it is not below 0.05.

        Raises:
            InputError: If there is neither record nor truth.
        """
        bands_wanted = {level: central(level)[::2] for level in levels}
        truth = {} if self.truth is None else {q: self.truth[q].values for q in self.quantities if q in self.truth}
        rows = []
        for kind, reference in (("record", self.record), ("truth", truth)):
            for name in (q for q in self.quantities if q in reference):
                if kind == "record" and name not in self.recorded_with and not self.held_out.any():
                    continue
                draws = self.as_recorded(name) if kind == "record" else self.draws[name]
                known = np.isfinite(reference[name]) & self.counted
                row: dict[str, Any] = {"quantity": name, "reference": kind, "samples": int(known.sum())}
                for level, ends in bands_wanted.items():
                    row[f"inside {100 * level:g} %"] = shares_inside(draws.values, reference[name], known, ends)[0]
                p = p_value(draws.values, reference[name], known, bands_wanted[max(levels)])
                row["p"] = np.nan if p is None else p
                rows.append(row | {"passed": bool(row["p"] >= _RARE)})
        if not rows:
            raise InputError(Fault(f"forecast of {self.name}", "no record", "a flight with a record to check by"))
        return pd.DataFrame(rows)

    def to_dataset(self) -> xr.Dataset:
        """Quantiles with record and truth, as ``predictions.nc`` of a run has them."""
        one, role = self._prediction, "predict" if self.held_out.any() else "identify"
        return bands.dataset(one, one.time, self.quantities, self.truth, self.record, self.held_out, role)

    def plot(self, limits: Mapping[str, float] | None = None) -> Figure:
        """Bands over time with record and truth, a panel per quantity.

        Args:
            limits: Limits by quantity (SI), drawn as lines.
        """
        from bayeschute.report.figures.record_figures import band_figure

        return band_figure(self.to_dataset(), limits)

    def plot_band(self, quantity: str, *, limit: str | float | None = None, ax: Axes | None = None) -> Axes:
        """Band of one quantity over time with record and truth.

        Args:
            quantity: Its name.
            limit: Such as ``"33 ft/s"`` or a number in SI, drawn as a line.
            ax: Where to draw; a legend is yours to add (``ax.legend()``). New axes with a legend where None.

        Raises:
            InputError: If quantity or limit are none that can be.

        Example:
            >>> forecast.plot_band("descent_rate", limit="12 m/s").get_ylabel()
            '[m/s]'
        """
        from bayeschute.report.figures.canvas import WIDTH, axes_or_new, legend_of
        from bayeschute.report.figures.record_figures import band

        self._values(quantity)  # refuses what was not predicted
        bound = None if limit is None else si("limit", limit, self.draws[quantity].attrs["units"])
        drawn = band(axes_or_new(ax, WIDTH, 3.0), self.to_dataset(), quantity, bound)
        drawn.set_xlabel("time [s]")
        if ax is None:
            legend_of([drawn], markerscale=2)
        return drawn

    def __repr__(self) -> str:
        """Flight, quantities and draws."""
        sizes = self.draws.sizes
        told = f"{sizes['draw']} draws of {', '.join(self.quantities)} at {sizes['time']} times"
        told = f"Forecast of {self.name}: {told}, {self.draws.attrs['failed']} failed"
        return "; ".join(filter(None, (told, self.draws.attrs.get("lost"), caveat(self.failed_checks, self.level))))

    def _repr_html_(self) -> str:
        """Medians and 90 % intervals of the mean over the flight, as a table."""
        return html.summary(repr(self), "mean over the flight", self.summary())


_RARE = 0.05  # share of flights that are inside their bands for as little of the time: fewer, and a band is too narrow


def _central(draws: Array, level: float) -> Array:
    """Lower end, median and upper end (3, T) of the central band of draws (B, T)."""
    return bands.quantiles(draws, central(level))


def _led_by(spec: Study, flight: str, like: str | None) -> Study:
    """The study with that fitted flight first by whose parameters another flight is predicted."""
    bodies = [f.name for f in spec.with_role("identify")]
    if spec.model != "descent" and not spec.priors.vary:
        if like is None:
            return spec
        raise InputError(Fault("like", repr(like), "no name: all fitted flights share their parameters"))
    if like is None and len(bodies) > 1:
        do = f"Say like={bodies[0]!r} in Python, --like {bodies[0]} in the shell."
        raise InputError(Fault(f"flight {flight}", f"a posterior of {len(bodies)} bodies", "which of them flies", do))
    if like is not None and like not in bodies:
        raise InputError(Fault("like", repr(like), f"one of {', '.join(bodies)}"))
    return replace(spec, flights=tuple(sorted(spec.flights, key=lambda f: f.name != (like or bodies[0]))))


def forecast_of(job: Job, flight: FlightSpec) -> Forecast:
    """Forecast of a flight whose record, fit and checks a job has."""
    return Forecast.of(job, widened(forecast_flight(job, flight), widening(job)))


def stored_forecast_of(job: Job, flight: FlightSpec) -> Forecast | None:
    """Forecast of a flight as a finished run has drawn it; None where it keeps no or not all draws."""
    stored = stored_forecast(job, flight)
    return None if stored is None else Forecast.of(job, stored)


def forecast(
    spec: Study, files: Files, flight: object, draws: int | None, seed: int | None, like: str | None
) -> Forecast:
    """Forecast of a flight by a posterior's study and files; see `Posterior.predict`.

    Raises:
        InputError: If what is to fly is no `Flight`, or has the name of one that was fitted, or none of several bodies
            is named.
    """
    if not isinstance(flight, Flight):
        do = "Take one of a study, study.flights['name'], or make one of a record: Flight(record, name=...)."
        raise InputError(Fault("flight", repr(flight)[:100], "a Flight", do))
    spec = spec if seed is None else replace(spec, seed=seed)
    if draws is not None:
        spec = replace(spec, predict=spec.predict.model_copy(update={"draws": int(draws)}))
    asked = flight.spec
    fitted = next((f for f in spec.flights if f.name == asked.name), None)
    taken = Fault(f"flight {asked.name}", "the name of a fitted flight", "a name of its own", _RENAME)
    if fitted is not None and (
        replace(asked, roles=fitted.roles, vehicle=fitted.vehicle) != fitted
        or flight.vehicle != (fitted.vehicle or spec.vehicle)
    ):
        raise InputError(taken)
    if fitted is None:
        spec = _led_by(spec, asked.name, like)
        vehicle = flight.vehicle if flight.vehicle != spec.vehicle else None
        asked = replace(asked, roles=("predict",), vehicle=vehicle)
        spec = replace(spec, flights=(*spec.flights, asked))
    with workspace(spec, files) as job:
        if fitted is not None and flight.raw is not None and not flight.record.equals(load_flight(job, asked.name)):
            raise InputError(taken)
        if fitted is None:
            ingest_flight(job, asked, read_and_judge(job, asked, flight.raw))
        return forecast_of(job, fitted or asked)
