"""Stages after the fit: checks, predictions, risk files, summary and report."""

from __future__ import annotations

import platform
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import arviz_stats
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.flight.record import repairs
from bayeschute.flight.reconstruct import reconstruct
from bayeschute.forecast import bands, risk as risk_files
from bayeschute.inference.target import linearise, residuals, standardised
from bayeschute.study import setup
from bayeschute.study.load import study_hash
from bayeschute.study.study import Flight
from bayeschute.study.work_data import load_flight, load_priors, load_truth
from bayeschute.study.work_fit import Group, Stored, data_of, gaussian_summary, groups, load_fit, summary_draws

if TYPE_CHECKING:
    from bayeschute.study.stages import Job

Array = NDArray[np.float64]
OPENING = 5.0  # [s] of its record by which a flight to be predicted is known


def check(job: Job) -> str:
    """Numbers that say whether the fit may be believed."""
    checks: dict[str, dict[str, Any]] = {}

    def add(name: str, value: float, bound: float, passed: bool, detail: str) -> None:
        checks[name] = {"passed": bool(passed), "value": float(value), "bound": bound, "detail": detail}

    tree = xr.open_datatree(job.out / "posterior.nc", engine="h5netcdf")
    posterior = tree["posterior"].ds.load()
    tree.close()
    rhat, bulk, tail = (_over(posterior, f) for f in (arviz_stats.rhat, _ess_bulk, _ess_tail))
    add("rhat", max(rhat.values()), 1.01, max(rhat.values()) < 1.01, "largest R-hat of any parameter")
    add("ess_bulk", min(bulk.values()), 400.0, min(bulk.values()) > 400.0, "least bulk effective sample size")
    add("ess_tail", min(tail.values()), 400.0, min(tail.values()) > 400.0, "least tail effective sample size")
    steps, share, failed, evaluations, converged = [], [], 0, 0, True
    for i, group in enumerate(groups(job)):
        stored = load_fit(job, group)
        converged &= stored.optimum.converged
        failed, evaluations = failed + stored.failed, evaluations + stored.evaluations
        for flight, u in zip(stored.marginal.flights, stored.optimum.u, strict=True):
            steps.append(_step_error(flight, stored, u))
            share.append(_innovation_share(flight, stored, u))
        job.say("check")((i + 1) / len(groups(job)), group.name)
    add("optimum", float(not converged), 0.0, converged, "fits whose optimum did not converge")
    add("failed_solves", failed / max(evaluations, 1), 0.01, failed <= 0.01 * evaluations, f"{failed} of {evaluations} simulations failed while sampling")
    add("step_error", max(steps), 0.2, max(steps) < 0.2, "integration error over the white noise of the channel, largest")
    worst = max(share, key=lambda s: abs(s - 0.9))
    add("innovations", worst, 0.9, abs(worst - 0.9) < 0.04, "share of standardised innovations within the central 90 %; bound is the target, 0.04 either way")
    job.save("checks.json", {"checks": checks, "rhat": rhat, "ess_bulk": bulk, "ess_tail": tail})
    missed = [name for name, c in checks.items() if not c["passed"]]
    return "all passed" if not missed else "missed: " + ", ".join(missed)


def _ess_bulk(x: xr.DataArray) -> Any:
    return arviz_stats.ess(x, method="bulk")


def _ess_tail(x: xr.DataArray) -> Any:
    return arviz_stats.ess(x, method="tail")


def _over(posterior: xr.Dataset, function: Any) -> dict[str, float]:
    return {str(name): float(np.asarray(function(posterior[name]))) for name in posterior.data_vars}


def _step_error(flight: Any, stored: Stored, u: Array) -> float:
    """Largest change of an output when the integration step is halved, over that output's white noise."""
    finer = replace(flight, model=replace(flight.model, substeps=2 * flight.model.substeps))
    theta = stored.optimum.theta
    change = np.abs(np.asarray(residuals(flight, theta, u)) - np.asarray(residuals(finer, theta, u)))
    white = np.asarray(stored.hyper.outputs(flight).white)
    return float(np.max(change / np.maximum(white, np.asarray(stored.hyper.outputs(flight).correlated) * 0.1)))


def _innovation_share(flight: Any, stored: Stored, u: Array) -> float:
    """Share of innovations at the optimum within +-1.645."""
    s = np.asarray(standardised(flight, stored.hyper, linearise(flight, stored.optimum.theta, u).residual, u))
    present = np.asarray(flight.present).ravel()
    return float(np.mean(np.abs(s[: present.size][present]) < 1.6449))


def _group_of(job: Job, flight: Flight) -> Group:
    """The fit whose parameters predict a flight: its own where it was fitted, else the study's only one."""
    todo = groups(job)
    return next((g for g in todo if flight in g.flights), todo[0])


def predict(job: Job) -> str:
    """Bands of every flight that is fitted or predicted."""
    from bayeschute.study.stages import write_whole

    study, made, finals = job.study, {}, {}
    flights = [f for f in study.flights if {"identify", "predict"} & set(f.roles)]
    coverage: dict[str, Any] = {}
    for i, flight in enumerate(flights):
        group = _group_of(job, flight)
        stored = load_fit(job, group)
        flat = stored.theta.reshape(-1, stored.theta.shape[-1])
        picked = flat[np.linspace(0, len(flat) - 1, min(study.predict.draws, len(flat))).astype(int)]
        record, truth = load_flight(job, flight.name), load_truth(job, flight.name)
        time = record["time"].values
        if flight in group.flights:
            marginal, index = stored.marginal, group.flights.index(flight)
            until = flight.identify_until.at(time[0], time[-1]) if flight.identify_until is not None else np.inf
        else:
            posterior = gaussian_summary(group.priors, stored.theta)
            data = bands.hide_after(data_of(job, flight, group.priors), OPENING)
            marginal, index, until = bands.opened(data, stored.hyper, posterior), 0, time[0] + OPENING

        def tell(share: float, i: int = i, name: str = flight.name) -> None:
            job.say("predict")((i + share) / len(flights), name)

        prediction = bands.predict(marginal, index, picked, study.seed + 100 + i, tell)
        held_out = time > until
        counted = held_out if held_out.any() else np.ones(time.size, bool)
        recorded = _recorded(job, flight, record)
        role = "predict" if held_out.any() else "identify"
        made[flight.name] = bands.dataset(prediction, time, study.predict.quantities, truth, recorded, held_out, role)
        coverage[flight.name] = {
            q: {
                "truth": None if truth is None else bands.coverage(prediction, q, truth[q].values, counted),
                "record": bands.coverage(prediction, q, recorded[q], counted) if q in recorded else None,
            }
            for q in study.predict.quantities
            if q in prediction.draws
        }
        finals[flight.name] = _statistics(prediction, counted)
    write_whole(job.out / "predictions.nc", lambda p: xr.DataTree.from_dict({f"/{k}": v for k, v in made.items()}).to_netcdf(p, engine="h5netcdf"))
    job.save("coverage.json", setup.as_plain(coverage))

    def write(path: Any) -> None:
        with path.open("wb") as file:
            np.savez(file, **{f"{f}|{k}": v for f, table in finals.items() for k, v in table.items()})

    write_whole(job.out / "fit" / "statistics.npz", write)
    return f"{len(flights)} flights"


def _recorded(job: Job, flight: Flight, record: xr.Dataset) -> dict[str, Array]:
    """Quantities of interest as the record has them."""
    if job.study.vehicle is None:
        return {"descent_rate": record["descent_rate"].values}
    seen = reconstruct(record, setup.geometry(job.study.vehicle, flight.capsule_mass))
    names = ("swing_angle", "descent_rate", "sea_level_descent_rate", "flyout_angle")
    return {name: seen[name].values for name in names}


def _statistics(prediction: bands.Prediction, counted: NDArray[np.bool_]) -> dict[str, Array]:
    """Per draw: final, maximum and mean of every quantity over the counted samples, and the touchdown."""
    table = {}
    for name, values in prediction.draws.items():
        part = values[:, counted]
        table |= {f"{name}|final": part[:, -1], f"{name}|maximum": part.max(axis=1), f"{name}|mean": part.mean(axis=1)}
    last = prediction.touchdown
    table["touchdown|vertical_speed"] = last[:, 2]
    table["touchdown|horizontal_speed"] = np.hypot(last[:, 0], last[:, 1])
    if "swing_angle" in prediction.draws:
        table["touchdown|swing_amplitude"] = prediction.draws["swing_angle"][:, counted].max(axis=1)
    table["touchdown|sea_level_rate"] = prediction.draws["sea_level_descent_rate"][:, -1]
    return table


def _load_statistics(job: Job) -> dict[str, dict[str, Array]]:
    with np.load(job.out / "fit" / "statistics.npz") as file:
        tables: dict[str, dict[str, Array]] = {}
        for key in file.files:
            flight, name = key.split("|", 1)
            tables.setdefault(flight, {})[name] = file[key]
    return tables


def risk(job: Job) -> str:
    """Files for risk assessors, and the requirements."""
    study, tables = job.study, _load_statistics(job)
    draws, units = summary_draws(job)
    touchdown = {f: {k.split("|")[1]: v for k, v in t.items() if k.startswith("touchdown|")} for f, t in tables.items()}
    ess = job.load("checks.json")["ess_bulk"]
    independent = int(min(min(ess.values()), study.predict.draws))
    risk_files.write_risk(job.out / "risk", draws, touchdown, units, effective=ess, independent=independent)
    rows = []
    predicted = [f.name for f in study.flights if "predict" in f.roles]
    for wanted in study.requirements:
        limit = {"at_most": wanted.at_most} if wanted.at_most is not None else {"at_least": wanted.at_least}
        for name in predicted:
            samples = tables[name].get(f"{wanted.quantity}|{wanted.statistic}")
            if samples is not None:
                rows.append(
                    risk_files.requirement_check(
                        samples, name=wanted.name, quantity=wanted.quantity, unit=bands.UNITS[wanted.quantity], run=name,
                        statistic=wanted.statistic, independent=independent, **limit,
                    )
                )  # fmt: skip
    job.save("risk/requirements.json", setup.as_plain(rows))
    return f"{len(rows)} requirements checked"


def report(job: Job) -> str:
    """Summary and report."""
    from bayeschute.report.html import build_report

    job.save("summary.json", setup.as_plain(_summary(job)))
    build_report(job.out)
    return str(job.out / "report.html")


def _summary(job: Job) -> dict[str, Any]:
    study, facts, checked = job.study, job.load("fit/facts.json"), job.load("checks.json")
    draws, units = summary_draws(job)
    tree = xr.open_datatree(job.out / "posterior.nc", engine="h5netcdf")
    prior = tree["prior"].ds.load()
    diverging = int(tree["sample_stats"]["diverging"].sum()) if "sample_stats" in tree.children and "diverging" in tree["sample_stats"] else 0
    tree.close()
    truth = _true_values(job)
    parameters = {}
    for name, x in draws.items():
        before, flat = prior[name].values.ravel(), x.ravel()
        q05, q50, q95 = np.quantile(flat, [0.05, 0.5, 0.95])
        entry = {
            "mean": flat.mean(), "sd": flat.std(), "q05": q05, "q50": q50, "q95": q95, "rhat": checked["rhat"][name],
            "ess_bulk": checked["ess_bulk"][name], "ess_tail": checked["ess_tail"][name], "prior_mean": before.mean(),
            "prior_sd": before.std(), "contraction": 1.0 - (flat.std() / before.std()) ** 2, "unit": units[name],
        }  # fmt: skip
        if name in truth:
            entry["truth"] = truth[name]
        parameters[name] = entry
    some = next(iter(draws.values()))
    seconds = sum(v for k, v in facts["wall"].items() if k != "fit_s")
    checks = dict(checked["checks"])
    checks["calibration"] = {"passed": None, "value": None, "bound": None, "detail": "no calibration of this configuration is stored"}
    missed = [k for k, c in checked["checks"].items() if not c["passed"]]
    label = "not verified: no calibration of this configuration is stored" + (f"; missed {', '.join(missed)}" if missed else "")
    stored = load_fit(job, groups(job)[0])
    channels = list(study.noise.channels())
    noise, hyper = stored.hyper.noise, stored.hyper
    return {
        "title": study.title, "model": study.model, "quick": job.quick, "label": label, "seed": study.seed,
        "vehicle": study.vehicle.name if study.vehicle is not None else None,
        "flights": {f.name: _flight_entry(job, f) for f in study.flights},
        "parameters": parameters,
        "sampling": {
            "sampler": study.sampler.kind, "chains": some.shape[0], "draws": some.shape[1], "divergences": diverging,
            "failed_solves": facts["failed"], "wall_s": seconds, "wall": facts["wall"],
            "min_ess_per_s": min(checked["ess_bulk"].values()) / seconds,
        },
        "noise": {
            c: {"white": noise.white[i], "correlated": noise.correlated[i], "time_constant": noise.time_constant[i], "unit": _CHANNEL_UNIT[c]}
            for i, c in enumerate(channels)
        },
        "wind": {"sd": hyper.latent_sd, "time_constant": hyper.latent_time_constant, "knots": study.noise.wind.knots},
        "coverage": job.load("coverage.json"),
        "checks": checks,
        "requirements": job.load("risk/requirements.json"),
        "notes": [*facts["notes"], *_notes(job)],
        "versions": {name: version(name) for name in ("bayeschute", "jax", "numpyro", "emcee", "arviz-base", "numpy", "scipy")} | {"python": platform.python_version()},
        "hashes": {"study": study_hash(study), "run": job.hash},
    }  # fmt: skip


_CHANNEL_UNIT = {"canopy_position": "m", "capsule_velocity": "m/s", "capsule_attitude": "rad", "descent_rate": "m/s"}


def _flight_entry(job: Job, flight: Flight) -> dict[str, Any]:
    record = load_flight(job, flight.name)
    time = record["time"].values
    listed = [r._asdict() for r in repairs(record)]
    source = "virtual drop" if flight.virtual is not None else flight.path.name if flight.path else ""
    return {"roles": list(flight.roles), "samples": time.size, "duration_s": time[-1] - time[0], "repairs": listed, "source": source}


def _true_values(job: Job) -> dict[str, float]:
    """Values the virtual drop was flown with; terms that were selected but not flown have the true value 0."""
    study = job.study
    if study.vehicle is None or any(f.virtual is None for f in study.with_role("identify")):
        return {}
    aero, risers = study.vehicle.aero, study.vehicle.risers
    flown = {f"axial[{k}]": v for k, v in aero.axial.items()} | {f"transverse[{k}]": v for k, v in aero.transverse.items()}
    flown |= {"riser_length": risers.length, "riser_stiffness": risers.stiffness, "riser_damping": risers.damping}
    return {p.name: float(flown.get(p.name, 0.0)) for p in load_priors(job)}


def _notes(job: Job) -> list[str]:
    """What a reader of the numbers must know."""
    notes = [
        "Noise parameters are set to their greatest evidence and held there while parameters are drawn; intervals do not carry their uncertainty.",
        "Initial states and latent disturbances are integrated out as Gaussian about the optimum; the parameters are drawn from that density exactly.",
    ]
    study = job.study
    if study.model == "cluster":
        assert study.vehicle is not None
        notes.append(f"A flight to be predicted is known by the first {OPENING:g} s of its record and its recorded wind; bands are scored after that.")
        flown = {f"axial[{k}]" for k in study.vehicle.aero.axial} | {f"transverse[{k}]" for k in study.vehicle.aero.transverse}
        found = {p.name for p in load_priors(job) if "[" in p.name}
        if flown - found and study.flights[0].virtual is not None:
            notes.append("Flown but not selected: " + ", ".join(sorted(flown - found)) + ".")
    else:
        notes.append("Air density is taken by altitude from the record or the standard atmosphere, and counted as known.")
    return notes


