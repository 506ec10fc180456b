"""Table 7.1-2 from a virtual CDT 3-11: does the planar dumbbell find the numbers it was flown with?

For every seed the dumbbell flies a swing like CDT 3-11's with the published coefficients, under turbulence and with
noisy instruments. Two fits, both started 10-50 % off: classical output error (white residuals, no unknown wind) with
raw and corrected standard errors, the form of the report's table; and the default, a latent wind error. Each foretells
a CDT 3-12 look-alike, another capsule in another wind, of which only the opening is known: its frequency and amplitude
stand beside those of the true flight, and beside its limit cycle in still air the one that the true parameters have.

    python benchmarks/dumbbell_recovery.py --seeds 1 2 3 [--json]
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from command import parser_of, print_result

from bayeschute.aero.published import load_published
from bayeschute.core.units import to_si
from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import sampler
from bayeschute.posterior.assess import output_error
from bayeschute.posterior.fit.joint_fit import joint_fit
from bayeschute.posterior.fit.laplace_fit import find
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.records.sensors import SensorNoise
from bayeschute.reduced.dumbbell import Dumbbell
from bayeschute.reduced.dumbbell_data import STILL, WIND, dumbbell_data
from bayeschute.reduced.published_models import planar_aero
from bayeschute.reduced.virtual_swing import Swing, SwingDrop, fly_swing, predict_swings, swing_of
from bayeschute.virtual.drop import Turbulence
from bayeschute.virtual.virtual_wind import WindProfile

FT, SLUG, DEGREE = to_si("1 ft", "m"), to_si("1 slug", "kg"), to_si("1 deg", "rad")
CANOPIES = Canopies(10563.0 * FT**2, 116.0 * FT, 32.0 * FT, 328.0 / 32.174 * SLUG, 140164.0 * FT**3)
BASE = Dumbbell(21906.0 / 32.174 * SLUG, 235.0 * FT, CANOPIES, 32.174 * FT)  # tables 6.1.1 and 7.1-1
LIGHTER = replace(BASE, capsule_mass=to_si("20340 lb", "kg"))
TABLE = load_published("table-7.1-2")
AERO, TRUTH = planar_aero(TABLE), TABLE.estimates()
GUSTY = Turbulence(2.0 * FT, 0.8 * FT, 6.0)
SENSORS = {
    "swing_angle": SensorNoise(0.12 * DEGREE, 0.2 * DEGREE, 2.0),
    "capsule_velocity": SensorNoise(0.06, 0.12, 3.0),
    "wind": SensorNoise(0.0, 1.0 * FT, 20.0),
}
ALTITUDES, STILL_AIR = tuple(h * FT for h in (0.0, 2500.0, 5000.0, 8000.0)), (0.0,) * 4
FIRST_WIND = WindProfile(ALTITUDES, tuple(v * FT for v in (5.0, 12.0, 20.0, 24.0)), STILL_AIR)
SECOND_WIND = WindProfile(ALTITUDES, tuple(v * FT for v in (6.0, 14.0, 22.0, 26.0)), STILL_AIR)
FIRST = SwingDrop(90.0, 0.1, 6500.0 * FT, 17.0 * DEGREE, 0.0, FIRST_WIND, GUSTY, SENSORS)
SECOND = SwingDrop(90.0, 0.1, 7000.0 * FT, 12.0 * DEGREE, 0.0, SECOND_WIND, GUSTY, SENSORS)
SETTLING = SwingDrop(300.0, 0.1, 7000.0 * FT, 17.0 * DEGREE)
AFTER, SETTLED = 30.0, 150.0  # [s]
DRAWS = 64
WIDE = {"C_A0": 0.5, "C_Aalpha": 1.5, "alpha_0": 0.15, "C_Nalpha": 0.5, "C_Nalphadot": 1.0}
WHITE = NoiseParameters(Noise(np.array([0.4 * DEGREE, 0.3]), np.full(2, 1e-6), np.ones(2)), ())
COLORED = NoiseParameters(
    Noise(np.array([0.12 * DEGREE, 0.06]), np.array([0.2 * DEGREE, 0.12]), np.array([2.0, 2.0])),
    tuple(np.array([sd * FT, time]) for sd, time in ((2.0, 5.0), (1.0, 5.0), (1.0, 20.0), (1.0, 20.0))),
)


def priors_off(seed: int) -> list[Prior]:
    """Wide priors whose centres, where the fits start, are 10-50 % off."""
    rng = np.random.default_rng([seed, 1])
    off = {name: 1.0 + rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0]) for name in TRUTH}
    return [Prior(p.name, p.estimate * off[p.name], WIDE[p.name], False, p.unit, "off") for p in TABLE.parameters]


def foretold(
    name: str, draws: np.ndarray, hyper: NoiseParameters | None, priors: list[Prior], seed: int
) -> dict[str, Any]:
    """Frequency and amplitude of the look-alike and of its limit cycle, as foretold and as true."""
    record, truth = fly_swing(SECOND, LIGHTER, AERO, 1000 + seed)
    settling, _ = fly_swing(SETTLING, LIGHTER, AERO, 0)
    settling = settling.assign(density=settling["density"] * 0.0 + float(settling["density"].mean()))
    rng = np.random.default_rng([seed, 3])
    time, angle = truth["time"].values, truth["swing_angle"].values
    seen = time >= AFTER
    exact = np.array([list(TRUTH.values())])
    made: dict[str, Any] = {}
    cases: list[tuple[str, xr.Dataset, float, NoiseParameters | None]] = [
        ("flight", record, AFTER, hyper),
        ("limit_cycle", settling, SETTLED, None),
    ]
    for case, one, after, law in cases:
        data = dumbbell_data(one, LIGHTER, AERO, priors, WIND if law is not None else STILL)
        found = predict_swings(data, law, draws, after, rng)
        whole = np.isfinite(found).all(axis=1)
        middle = Swing(*np.median(found[whole], axis=0))
        true = (
            swing_of(time[seen], angle[seen])
            if case == "flight"
            else Swing(*predict_swings(data, None, exact, after, rng)[0])
        )
        low, high = np.quantile(found[whole], [0.05, 0.95], axis=0)
        made[case] = {
            q: {"median": middle[i], "q05": low[i], "q95": high[i], "truth": true[i], "off": middle[i] / true[i] - 1.0}
            for i, q in enumerate(Swing._fields)
        } | {"no_swing": int((~whole).sum())}
        print(f"  {name}, {case.replace('_', ' ')}:", end="")
        for q, unit, factor in (("frequency", "Hz", 1.0), ("amplitude", "deg", 1.0 / DEGREE)):
            v = {k: x if k == "off" else factor * x for k, x in made[case][q].items()}
            print(f"  {q} {v['median']:.4g} [{v['q05']:.4g}, {v['q95']:.4g}] {unit}, true {v['truth']:.4g}", end="")
            print(f" ({100 * v['off']:+.1f} %)", end="")
        print()
    return made


def one(seed: int) -> dict[str, Any]:
    """Fly, fit twice, foretell."""
    record, _ = fly_swing(FIRST, BASE, AERO, seed)
    priors = priors_off(seed)
    rows: dict[str, dict[str, float]] = {}
    flights = [dumbbell_data(record, BASE, AERO, priors, STILL)]
    settled = joint_fit(flights, priors, NoisePrior(WHITE))
    bounds = output_error.bounds(flights, settled.hyper, priors, settled.optimum)
    found = find([dumbbell_data(record, BASE, AERO, priors, WIND)], priors, NoisePrior(COLORED))
    marginal = found.marginal
    xi = sampler.sample(marginal, "nuts", 4, 300, 500, seed).xi
    wide = widened(xi, found.noise_effect, found.noise_parameter_covariance, seed).reshape(-1, len(priors))
    draws = np.asarray(marginal.centre) + wide @ np.asarray(marginal.scale).T
    print(f"seed {seed}  {'':6} start    truth | output error  raw sd  corrected | latent wind      sd | report's sd")
    for i, (p, row) in enumerate(zip(TABLE.parameters, output_error.table(bounds, priors), strict=True)):
        mean, sd = float(draws[:, i].mean()), float(draws[:, i].std())
        rows[p.name] = {
            "truth": p.estimate, "start": priors[i].centre, "estimate": row.estimate, "raw_sd": row.raw_sd,
            "corrected_sd": row.corrected_sd, "latent_mean": mean, "latent_sd": sd, "report_sd": p.standard_error,
        }  # fmt: skip
        print(f"  {p.name:12s} {priors[i].centre:7.3f} {p.estimate:8.3f} | {row.estimate:12.3f}", end="")
        print(
            f" {row.raw_sd:7.4f} {row.corrected_sd:10.4f} | {mean:11.3f} {sd:7.4f} | {p.standard_error:7.4f}  {p.unit}"
        )
    rng = np.random.default_rng([seed, 2])
    normal = output_error.gaussian_draws(bounds, bounds.theta, np.eye(len(priors)), 1, DRAWS, rng)
    by = {
        "output error": (bounds.theta + normal.xi[0], None),
        "latent wind": (draws[rng.permutation(len(draws))[:DRAWS]], found.hyper),
    }
    predicted = {name: foretold(name, x, law, priors, seed) for name, (x, law) in by.items()}
    return {
        "parameters": rows,
        "predicted": predicted,
        "converged": bool(settled.optimum.converged and found.optimum.converged),
    }


def main() -> None:
    """Run, print the tables, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    given = parser.parse_args()
    seeds = {seed: one(seed) for seed in given.seeds}
    rows = [row for s in seeds.values() for row in s["parameters"].values()]
    z = {
        "output_error": np.array([(r["estimate"] - r["truth"]) / r["corrected_sd"] for r in rows]),
        "latent_wind": np.array([(r["latent_mean"] - r["truth"]) / r["latent_sd"] for r in rows]),
    }
    ratio = np.array([r["corrected_sd"] / r["report_sd"] for r in rows])
    off = {
        f"{name}_{case}_{q}_off": float(np.max(np.abs([s["predicted"][key][case][q]["off"] for s in seeds.values()])))
        for name, key in (("output_error", "output error"), ("latent_wind", "latent wind"))
        for case in ("flight", "limit_cycle")
        for q in Swing._fields
    }
    for name, values in z.items():
        share, worst = np.mean(np.abs(values) < 1.645), np.max(np.abs(values))
        print(f"{name.replace('_', ' ')}: {share:.0%} of {values.size} true values in 90 %, worst z {worst:.2f}")
    low, middle, high = ratio.min(), np.median(ratio), ratio.max()
    print(f"corrected standard errors over the report's: {low:.2f} to {high:.2f}, median {middle:.2f}")
    for name, value in off.items():
        print(f"{name.replace('_', ' ')}, worst: {100 * value:.1f} %")
    ratios = {f"{k}_worst_z": float(np.max(np.abs(v))) for k, v in z.items()} | off
    ratios["corrected_over_report_sd_median"] = float(np.median(ratio))
    print_result(given, ratios, seeds)


if __name__ == "__main__":
    main()
