"""A run folder with every file of the contract, made up but in the right shapes and of the right size."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import xarray as xr
from arviz_base import from_dict

from bayeschute.prediction import risk_files

UNITS = {
    "axial[1]": "1",
    "axial[alpha^2]": "1",
    "transverse[e]": "1",
    "transverse[e*alpha^2]": "1",
    "transverse[rate]": "1",
    "transverse[repulsion(0.8)]": "1",
    "riser_stiffness": "N/m",
    "riser_damping": "N s/m",
    "riser_length": "m",
}
TRUTH = dict(zip(UNITS, (0.958, -0.87, -0.095, 2.66, -0.545, 0.30, 218_909.0, 145_939.0, 71.3232), strict=True))
SD = dict(zip(UNITS, (0.006, 0.15, 0.008, 0.31, 0.05, 0.06, 42_000.0, 39_000.0, 0.11), strict=True))
WIDENING = dict(zip(UNITS, (6.0, 4.0, 8.0, 5.0, 9.0, 4.0, 1.03, 1.08, 2.8), strict=True))
CHAINS, DRAWS = 4, 250
QUANTILES = [0.05, 0.25, 0.5, 0.75, 0.95]
Z = np.array([-1.645, -0.674, 0.0, 0.674, 1.645])


def _draws(rng: np.random.Generator) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, float]]:
    n = len(UNITS)
    mix = np.eye(n) + 0.35 * rng.normal(size=(n, n)) / math.sqrt(n)
    mix[3, 2] = -1.1
    z = np.zeros((CHAINS, DRAWS, n))
    for t in range(1, DRAWS):
        z[:, t] = 0.35 * z[:, t - 1] + math.sqrt(1 - 0.35**2) * rng.normal(size=(CHAINS, n))
    z = z @ mix.T / np.linalg.norm(mix, axis=1)
    shift = 0.6 * rng.normal(size=n)
    shift[5] = 2.1  # one truth lies outside its interval
    centre = {name: TRUTH[name] + shift[i] * SD[name] for i, name in enumerate(UNITS)}
    posterior = {name: centre[name] + SD[name] * z[..., i] for i, name in enumerate(UNITS)}
    prior = {
        name: centre[name] + SD[name] * WIDENING[name] * (0.3 * rng.normal() + rng.normal(size=(1, 1000)))
        for name in UNITS
    }
    return posterior, prior, centre


def _parameters(posterior: dict[str, np.ndarray], prior: dict[str, np.ndarray]) -> dict[str, dict[str, object]]:
    found = {}
    for name, x in posterior.items():
        q05, q50, q95 = np.quantile(x, [0.05, 0.5, 0.95])
        found[name] = {
            "mean": x.mean(),
            "sd": x.std(),
            "q05": q05,
            "q50": q50,
            "q95": q95,
            "rhat": 1.0 + 0.004 * abs(math.sin(x.mean())),
            "ess_bulk": 512.0,
            "ess_tail": 640.0,
            "prior_mean": prior[name].mean(),
            "prior_sd": prior[name].std(),
            "contraction": max(0.0, 1 - x.var() / prior[name].var()),
            "unit": UNITS[name],
            "truth": TRUTH[name],
        }
    return found


def _bands(rng: np.random.Generator, role: str, mean: dict[str, float]) -> xr.Dataset:
    time = np.arange(0.0, 90.0, 0.3)
    swing = np.abs(np.radians(17) * np.sin(2 * np.pi * 0.069 * time) + 1j * np.radians(6))
    shapes = {
        "swing_angle": (swing, np.radians(0.8 + 1.4 * (1 - np.exp(-time / 15)))),
        "descent_rate": (mean["rate"] + 0.5 * np.cos(4 * np.pi * 0.069 * time) - 0.004 * time, 0.28 + 0 * time),
        "sea_level_descent_rate": (mean["rate"] - 0.45 + 0.5 * np.cos(4 * np.pi * 0.069 * time), 0.27 + 0 * time),
        "flyout_angle": (np.radians(9) + np.radians(1.2) * np.sin(2 * np.pi * time / 15), np.radians(0.9) + 0 * time),
    }
    data: dict[str, object] = {}
    for name, (curve, sd) in shapes.items():
        band = np.maximum(curve + Z[:, None] * sd, 0.0)
        error = np.zeros(time.size)
        for t in range(1, time.size):
            error[t] = 0.97 * error[t - 1] + math.sqrt(1 - 0.97**2) * rng.normal()
        truth = curve + 0.9 * sd * error
        record = truth + 0.25 * sd * rng.normal(size=time.size)
        record[100:112] = np.nan
        units = {"units": "m/s" if "rate" in name else "rad"}
        data |= {name: (("quantile", "time"), band, units)}
        data |= {f"{name}_truth": ("time", truth, units), f"{name}_record": ("time", record, units)}
    share = np.array([[0.25, 0.05], [0.0, 0.0], [0.6, 0.9], [0.15, 0.05]])
    data["variance_share"] = (("source", "quantity"), share)
    data["held_out"] = ("time", np.ones(time.size, bool) if role == "predict" else time > 60.0)
    coords = {
        "quantile": QUANTILES,
        "time": time,
        "source": ["parameter", "noise", "wind", "initial state"],
        "quantity": ["swing_angle", "descent_rate"],
    }
    return xr.Dataset(data, coords, attrs={"role": role})


def _record(rng: np.random.Generator, repairs: list[dict[str, object]]) -> xr.Dataset:
    time = np.arange(0.0, 90.0, 0.1)
    velocity = np.stack([3 * np.sin(0.43 * time), 2 * np.cos(0.43 * time), 10 + 0.3 * np.cos(0.87 * time)], axis=1)
    velocity += 0.05 * rng.normal(size=velocity.shape)
    wind = np.stack([6 - 0.02 * time, -2 + 0.01 * time, 0 * time], axis=1)
    canopies = rng.normal(size=(time.size, 2, 3))
    return xr.Dataset(
        {
            "capsule_velocity": (("time", "axis"), velocity, {"units": "m/s"}),
            "canopy_position": (("time", "canopy", "axis"), canopies, {"units": "m"}),
            "wind": (("time", "axis"), wind, {"units": "m/s"}),
            "altitude": ("time", 1980 - 10 * time, {"units": "m"}),
        },
        {"time": time, "axis": ["north", "east", "down"], "canopy": [1, 2]},
        attrs={"repairs": json.dumps(repairs)},
    )


def _ranking(terms: list[str], first: float, kept: int, rng: np.random.Generator) -> list[dict[str, object]]:
    rows, mse = [], first
    step = np.r_[1.0, 0.08, 0.04 * 0.6 ** np.arange(len(terms))]
    for i, term in enumerate(terms):
        new = mse * (0.08 if i and i < kept else 0.9 + 0.05 * rng.random()) if i else mse
        pse = new + 2.0e-2 * first * (i + 1) * 0.5
        rows.append(
            {
                "term": term,
                "index": 10**i if i else 0,
                "a": step[i],
                "dmse": new - mse if i else -0.695,
                "mse": new,
                "pse": pse,
                "perr": 100 * math.sqrt(new) / 0.85,
                "r2": 100 * (1 - new / first),
                "f_ratio": 150 * 0.1**i,
                "pe": math.sqrt(pse),
            }
        )
        mse = new
    return rows


def _structure(rng: np.random.Generator) -> dict[str, object]:
    axial = ["1", "alpha^2", "q", "speed", "alpha", "proximity(0.8)"]
    transverse = ["e", "rate", "e*alpha^2", "repulsion(0.8)", "e*alpha", "side*e", "e*(e.rate)", "rate*alpha^2"]

    def coefficient(terms: list[str], kept: int, estimates: list[tuple[float, float]]) -> dict[str, object]:
        selected = [
            {"term": t, "estimate": e, "se": s, "white_se": 0.22 * s, "unit": "1"}
            for t, (e, s) in zip(terms, estimates, strict=False)
        ]
        lag = np.arange(0, 12, 0.1)
        return {
            "selected": selected,
            "ranking": _ranking(terms, 0.0226, kept, rng),
            "candidates": terms,
            "snr": 7.9,
            "sigma_max2": 1.0e-2,
            "penalty_factor": 1.0,
            "pse_minimum_at": kept,
            "sensitivity": [
                {"sigma_max2": 1.0e-2 * f, "low": 0.9e-2 * f, "high": high, "terms": terms[: kept + extra]}
                for f, high, extra in ((0.04, 1.8e-3, 3), (0.2, 9e-3, 1), (1.0, 4.5e-2, 0), (5.0, None, -1))
            ],
            "collinearity": {
                "max_correlation": 0.71,
                "pair": terms[:2],
                "max_vif": 2.1,
                "condition_index": 8.0,
                "flagged": False,
            },
            "null_model": {"name": "constant force", "r2": 0.71, "rms": 0.08},
            "residual": {
                "rms": 0.021,
                "autocorrelation_time": 1.9,
                "autocorrelation": (np.exp(-lag / 2) * np.cos(1.4 * lag)).tolist(),
                "lag": lag.tolist(),
            },
            "samples": 880,
            "check": {},
        }

    return {
        "coefficients": {
            "axial": coefficient(axial, 2, [(0.951, 0.021), (-0.81, 0.4)]),
            "transverse": coefficient(transverse, 4, [(-0.088, 0.03), (-0.52, 0.16), (2.4, 0.7), (0.42, 0.13)]),
        },
        "sufficiency": ["The record reaches angles of attack of 0.38 rad; nothing is known beyond."],
    }


def _flights() -> dict[str, dict[str, object]]:
    repairs = [
        {
            "kind": "gap",
            "variable": "canopy_position",
            "start": 30.0,
            "end": 33.4,
            "count": 34,
            "detail": "left missing",
        },
        {
            "kind": "outlier",
            "variable": "capsule_velocity",
            "start": 51.2,
            "end": 51.3,
            "count": 2,
            "detail": "9.1 robust standard deviations off; set to missing",
        },
        {
            "kind": "jump",
            "variable": "altitude",
            "start": 70.0,
            "end": 71.0,
            "count": 1,
            "detail": "-141 m in one sample; set to missing",
        },
    ]
    dropouts = [
        {
            "kind": "gap",
            "variable": "canopy_position.2",
            "start": 5.0 * i,
            "end": 5.0 * i + 0.1 * i,
            "count": i,
            "detail": "left missing",
        }
        for i in range(1, 9)
    ]
    repairs += dropouts
    prepared = {"kind": "resampled", "variable": "wind", "start": 0.0, "end": 89.9, "count": 900, "detail": "to 10 Hz"}
    repairs.append(prepared)
    return {
        "cdt-3-11": {"roles": ["structure", "identify"], "samples": 900, "duration_s": 89.9, "repairs": repairs},
        "cdt-3-12": {"roles": ["predict"], "samples": 900, "duration_s": 89.9, "repairs": []},
    }


def _checks() -> dict[str, dict[str, object]]:
    return {
        "rhat": {"passed": True, "value": 1.004, "bound": 1.01},
        "ess_bulk": {"passed": True, "value": 512.0, "bound": 400},
        "divergences": {"passed": True, "value": 0, "bound": 0},
        "bfmi": {"passed": True, "value": 0.93, "bound": 0.3},
        "solver_error": {"passed": True, "value": 0.004, "bound": 0.1},
        "posterior_predictive": {"passed": True, "value": 0.41, "bound": "0.05 to 0.95"},
        "calibration": {"passed": None, "value": None, "bound": "100 replicates"},
    }


def _identifiability(parameters: dict[str, dict[str, object]]) -> dict[str, object]:
    """One fit: stiffness and damping hang on their priors, length feels its own, a wind stands in for the damping."""
    told: dict[str, dict[str, object]] = {}
    for name in UNITS:
        facts: dict[str, object] = {"shift": 0.2, "noise_share": 0.02, "noise_partner": "wind, horizontal, sd"}
        facts |= {"noise_correlation": -0.1, "prior_sensitivity": 0.01, "likelihood_sensitivity": 0.09}
        told[name] = facts | {"contraction": parameters[name]["contraction"]}
    told["transverse[rate]"] |= {"noise_share": 0.21, "noise_correlation": 0.4}
    for name in ("riser_stiffness", "riser_damping"):
        told[name] |= {"prior_sensitivity": 0.13, "likelihood_sensitivity": 0.02}
        told[name]["likelihood_interval"] = {"level": 0.9, "low": None, "high": None, "unit": UNITS[name]}
    told["riser_length"] |= {"prior_sensitivity": 0.06}
    told["riser_length"]["likelihood_interval"] = {"level": 0.9, "low": 71.12, "high": 71.48, "unit": "m"}
    directions = [
        {"weights": {"riser_damping": 0.98}, "information": 0.01, "contraction": 0.0099, "words": "0.98 riser_damping"},
        {"weights": {}, "information": 30.0, "contraction": 0.968, "words": "0.81 axial[1] - 0.59 axial[alpha^2]"},
        {"weights": {}, "information": 9999.0, "contraction": 0.9999, "words": "0.99 transverse[rate]"},
    ]
    noise = {"wind, horizontal, sd": 0.89, "slow_wind, vertical, time constant": 0.02}
    return {"parameters": told, "directions": directions, "noise": noise}


def build_run(
    folder: Path, *, quick: bool = False, label: str = "not checked: no calibration run", seed: int = 1
) -> Path:
    """Write a complete run folder and return it."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    posterior, prior, _ = _draws(rng)
    stats = {"lp": rng.normal(size=(CHAINS, DRAWS)), "diverging": np.zeros((CHAINS, DRAWS), bool)}
    from_dict({"posterior": posterior, "prior": prior, "sample_stats": stats}).to_netcdf(
        folder / "posterior.nc", engine="h5netcdf"
    )
    flights = _flights()
    (folder / "flights").mkdir(exist_ok=True)
    for name, facts in flights.items():
        _record(rng, facts["repairs"]).to_netcdf(folder / "flights" / f"{name}.nc", engine="h5netcdf")  # type: ignore[arg-type]
    bands = {
        "cdt-3-11": _bands(rng, "identify", {"rate": 10.3}),
        "cdt-3-12": _bands(rng, "predict", {"rate": 10.0}),
    }
    xr.DataTree.from_dict(bands).to_netcdf(folder / "predictions.nc", engine="h5netcdf")
    (folder / "structure.json").write_text(json.dumps(_structure(rng)))
    rate = rng.normal(9.75, 0.24, 400)
    mean = rng.normal(9.75, 0.24, 400)
    final = {"descent_rate": rate * 1.01, "sea_level_descent_rate": rate}
    final |= {"horizontal_speed": np.abs(rng.normal(4, 1.5, 400)), "swing_angle": np.radians(rng.normal(9, 2.5, 400))}
    maximum = {"swing_angle": np.radians(rng.normal(18, 2.5, 400))}
    limit = 10.0584
    requirement = risk_files.requirement_check(
        mean,
        name="mean descent rate",
        quantity="sea_level_descent_rate",
        statistic="mean",
        unit="m/s",
        at_most=limit,
        run="cdt-3-12",
    )
    drawn = {"cdt-3-12": {"final": final, "maximum": maximum, "mean": {"sea_level_descent_rate": mean}}}
    risk_files.write_risk(folder / "risk", posterior, drawn, UNITS, requirements=[requirement])
    covered = {"swing_angle": {"truth": 0.91, "record": 0.88}, "descent_rate": {"truth": 0.87, "record": None}}
    summary = {
        "title": "Virtual CDT 3-11, and a CDT 3-12 look-alike predicted from it",
        "model": "cluster",
        "quick": quick,
        "label": label,
        "predictive": {
            "bound": 0.01,
            "checks": [
                {"flight": "cdt-3-11", "what": what, "statistic": "mean", "value": 0.05, "expected": 0.0, "p": p}
                for what, p in (("innovations of capsule_velocity.north", 0.02), ("disturbance wind 1", 0.6))
            ],
            "pit": {"cdt-3-11": {"capsule_velocity": [10, 12, 9, 11, 8, 10, 13, 9, 10, 8]}},
            "errors": [
                {
                    "flight": "cdt-3-11",
                    "what": "the mass of the capsule",
                    "unit": "%",
                    "estimate": 0.4,
                    "se": 0.5,
                    "moves": 0.8,
                    "p": 0.42,
                    "matters": True,
                    "do": "Weigh it.",
                }
            ],
        },
        "claim": {"sentences": ["Not promised by any calibration: riser_length."]},
        "flights": flights,
        "parameters": _parameters(posterior, prior),
        "sampling": {
            "sampler": "nuts",
            "chains": CHAINS,
            "draws": DRAWS,
            "divergences": 0,
            "failed_solves": 3,
            "wall_s": 61.2,
            "min_ess_per_s": 8.4,
        },
        "coverage": {"cdt-3-11": covered, "cdt-3-12": covered},
        "checks": _checks(),
        "identifiability": {"all": _identifiability(_parameters(posterior, prior))},
        "requirements": [requirement],
        "notes": ["The restoring force beyond 35 deg is not identified by this record; it is left out of the model."],
        "noise": {
            "canopy_position": {"white": 0.15, "correlated": 0.31, "time_constant": 2.1, "unit": "m"},
            "capsule_attitude": {"white": 0.0018, "correlated": 0.0035, "time_constant": 2.0, "unit": "rad"},
            "wind, horizontal": {"white": None, "correlated": 0.61, "time_constant": 5.2, "unit": "m/s"},
            "breathing": {"white": None, "correlated": 0.021, "frequency": 0.23, "damping_ratio": 0.06, "unit": "1"},
        },
        "vehicle": "CPAS capsule under two mains",
        "versions": {"bayeschute": "0.1.0", "jax": "0.10.2", "numpy": "2.4.6"},
        "seed": seed,
        "hashes": {"study.toml": "6c59dd1147eb600d13096aa7d491496e", "vehicle": "a1b2c3d4e5f60718"},
    }
    (folder / "summary.json").write_text(json.dumps(summary, indent=1))
    return folder
