"""Stages `predict` and `risk`: bands and statistics of every flight, risk files."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.files import write_whole
from bayeschute.core.netcdf_files import write_netcdf
from bayeschute.core.trees import load_tree, save_tree
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.prediction import bands, risk_files
from bayeschute.prediction.flight_statistics import flight_statistics
from bayeschute.prediction.held_shares import coverage, p_value
from bayeschute.records.reconstruct import reconstruct
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import summary_draws
from bayeschute.study.evidence.recalibrate import NAME as RECALIBRATION
from bayeschute.study.evidence.recalibrate import applied_recalibration, widening
from bayeschute.study.job import Job
from bayeschute.study.run.forecasts import FlightForecast, forecast_flights, widened
from bayeschute.study.study import Flight

Array = NDArray[np.float64]


STATISTICS = "fit/statistics.npz"


def predict(job: Job) -> str:
    """Bands and statistics of every flight that is fitted or predicted, both of the draws as recalibrated."""
    wanted = job.study.predict.quantities or ()
    made: dict[str, xr.Dataset] = {}
    statistics: dict[str, dict[str, dict[str, Array]]] = {}
    shares: dict[str, Any] = {}
    without: list[str] = []
    changed: list[str] = []
    by = widening(job)
    for one in (widened(foreseen, by) for foreseen in forecast_flights(job)):
        name, prediction, truth, counted = one.flight.name, one.prediction, one.truth, one.counted
        recorded = recorded_quantities(job, one.flight, one.record)
        role = "predict" if one.held_out.any() else "identify"
        made[name] = bands.dataset(prediction, one.time, wanted, truth, recorded, one.held_out, role)
        shares[name] = {
            q: {
                **({"truth": None} if truth is None else _held("truth", prediction.draws[q], truth[q].values, counted)),
                **_record_held(job, one, q, recorded),
                "draws": int(np.isfinite(prediction.draws[q]).all(axis=1).sum()),
                "failed": prediction.failed,
            }
            for q in wanted
            if q in prediction.draws
        }
        if not any(entry["draws"] for entry in shares[name].values()):
            without.append(f"{name} ({prediction.why})" if prediction.why else name)
        statistics[name] = flight_statistics(prediction, counted)
        changed += [name] if one.widened_by else []
    tree = xr.DataTree.from_dict({f"/{k}": v for k, v in made.items()})
    write_whole(job.out / "predictions.nc", partial(write_netcdf, tree))
    job.save("coverage.json", assemble.as_plain(shares))
    (job.out / RECALIBRATION).unlink(missing_ok=True)
    if by is not None:
        job.save(RECALIBRATION, by._replace(flights=tuple(changed))._asdict())
    save_tree(job.out / STATISTICS, statistics)
    none = f", no bands of {', '.join(without)}: every simulation failed" if without else ""
    return f"{len(made)} flights{none}"


def _held(what: str, draws: Array, reference: Array, counted: NDArray[np.bool_]) -> dict[str, float | None]:
    """Share of truth or record inside the band, and how often a flight of the forecast has no more there."""
    return {what: coverage(draws, reference, counted), f"{what}_p": p_value(draws, reference, counted)}


def _record_held(job: Job, one: FlightForecast, quantity: str, recorded: dict[str, Array]) -> dict[str, float | None]:
    """Share of recorded samples inside the band, the channel's noise added where the quantity has a channel.

    A quantity derived from several channels has no noise model here: compared with the wide band of an unseen flight
    that is negligible; for the narrow one of a fitted flight it would mislead, so there it is omitted.
    """
    noise = channel_noise(job, one.hyper, quantity)
    if quantity not in recorded or (noise is None and not one.held_out.any()):
        return {"record": None}
    seen = bands.recorded_draws(one.prediction, quantity, noise, one.seed)
    return _held("record", seen, recorded[quantity], one.counted)


def channel_noise(job: Job, hyper: NoiseParameters, quantity: str) -> tuple[float, float, float] | None:
    """Residual noise of the channel that records a quantity directly; None where it is derived from several."""
    channel = {"descent_rate": "descent_rate" if job.study.model == "descent" else "capsule_velocity"}.get(quantity)
    names = list(job.study.noise.channels())
    if channel not in names:
        return None
    noise, k = hyper.noise, names.index(channel)
    return float(noise.white[k]), float(noise.correlated[k]), float(noise.time_constant[k])


def recorded_quantities(job: Job, flight: Flight, record: xr.Dataset) -> dict[str, Array]:
    """Quantities of interest as the record has them."""
    if job.study.model == "descent":
        return {"descent_rate": record["descent_rate"].values}
    seen = reconstruct(record, assemble.geometry(job.study.vehicle_of(flight), flight.capsule_mass))
    names = ("swing_angle", "descent_rate", "sea_level_descent_rate", "flyout_angle")
    return {name: seen[name].values for name in names}


def risk(job: Job) -> str:
    """Files for risk assessment, and the requirements, from the draws of the bands (recalibrated where these are)."""
    study, tables = job.study, load_tree(job.out / STATISTICS, dict[str, dict[str, dict[str, Array]]])
    by = applied_recalibration(job)
    widened = {} if by is None else dict.fromkeys(by.flights, by.factors)
    draws, units = summary_draws(job)
    ess = job.load("checks.json")["ess_bulk"]
    independent = int(min(min(ess.values()), study.predict.draws))
    rows = []
    predicted = [f.name for f in study.flights if "predict" in f.roles]
    for wanted in study.requirements:
        limit = {"at_most": wanted.at_most} if wanted.at_most is not None else {"at_least": wanted.at_least}
        for name in predicted:
            samples = tables[name][wanted.statistic].get(wanted.quantity)
            if samples is not None:
                rows.append(
                    risk_files.requirement_check(
                        samples, name=wanted.name, quantity=wanted.quantity, unit=bands.UNITS[wanted.quantity],
                        run=name, statistic=wanted.statistic, independent=independent,
                        widened_by=widened.get(name, {}).get(wanted.quantity, 1.0), **limit,
                    )
                )  # fmt: skip
    risk_files.write_risk(
        job.out / "risk", draws, tables, units, None, ess, assemble.as_plain(rows), independent, widened
    )
    return f"{len(rows)} requirements checked"
