"""Are parameter intervals honest? Replicate flights of the default study, fitted with the flown terms and scored.

Every replicate is a new virtual drop (winds, gusts, breathing, sensor errors). It is fitted with the terms that it was
flown with, wide priors about the truth and the study's noise model; no structure is selected and nothing is drawn: the
mode of the marginal posterior and its Laplace covariance, widened by the uncertainty of the noise parameters, are
scored. With ``--known`` the noise parameters are those
that made the flight and the wind is recorded without error, so that only the treatment of the disturbances is tested.
Rows are appended to the output as they come; replicates that are there already are not flown again.

    python benchmarks/parameter_coverage.py --out runs/parameter-coverage.jsonl --replicates 20 [--known] [--json]
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of, print_result

STUDY = Path(__file__).parents[1] / "models" / "studies" / "cdt-3-11.toml"
WIDE = {"axial[1]": 0.3, "axial[alpha^2]": 1.0, "transverse[e]": 0.3, "transverse[e*alpha^2]": 1.5}
OTHERS = 0.5  # prior standard deviation of the other coefficients


def priors_about(study: Any, structure: Any, model: Any) -> list[Any]:
    """Priors centred on the flown values: wide for coefficients, the study's for the risers."""
    from bayeschute.aero.coefficient import Coefficient
    from bayeschute.likelihood.priors import Prior

    made = []
    for kind, terms, values in (
        ("axial", structure.axial, model.axial),
        ("transverse", structure.transverse, model.transverse),
    ):
        for term, value in zip(terms, values, strict=True):
            name = str(Coefficient(kind, term))
            made.append(Prior(name, float(value), WIDE.get(name, OTHERS), False, "1", "flown"))
    risers = model.risers
    made.append(Prior("riser_stiffness", float(np.log(risers.stiffness)), 0.2, True, "N/m", "flown"))
    made.append(Prior("riser_damping", float(np.log(risers.damping)), 0.15, True, "N s/m", "flown"))
    made.append(Prior("riser_length", float(risers.length), 0.3, False, "m", "flown"))
    return made


def flown(study: Any, seed: int, drop: Any = None, priors: Any = priors_about) -> tuple[Any, tuple[Any, ...]]:
    """The study's first flight from a seed, ready to be fitted with the terms that it flies, and the priors.

    Args:
        study: The study.
        seed: Of the flight.
        drop: What is flown; the study's own where None.
        priors: Makes the priors, as `priors_about` does.
    """
    from bayeschute.likelihood.channels import cluster_data
    from bayeschute.study.assembly import assemble
    from bayeschute.virtual.drop import fly

    model, structure = assemble.cluster(study.vehicle)
    record, _ = fly(assemble.drop(study.flights[0].virtual) if drop is None else drop, model, structure, seed)
    made = tuple(priors(study, structure, model))
    blank = replace(model, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    latent, channels = assemble.latent(study, structure.canopies), tuple(study.noise.channels())
    return cluster_data(record, blank, structure, made, channels, latent), made


def known_noise(drop: Any) -> Any:
    """The noise parameters that make a drop's record and disturbances."""
    from bayeschute.likelihood.joint import NoiseParameters
    from bayeschute.likelihood.noise import Noise

    rows = [drop.sensors[name] for name in ("canopy_position", "capsule_velocity", "capsule_attitude")]
    noise = Noise(*(np.array([getattr(r, k) for r in rows]) for k in ("white", "correlated", "time_constant")))
    gusts, breathing = drop.turbulence, drop.breathing
    return NoiseParameters(
        noise,
        (
            np.array([gusts.horizontal, gusts.time_constant]),
            np.array([gusts.vertical, gusts.time_constant]),
            np.array([0.005, 20.0]),  # nor a slow error of the wind
            np.array([0.005, 20.0]),
            np.array([breathing.amplitude, breathing.frequency, breathing.damping_ratio]),
        ),
    )


def one(study: Any, seed: int, known: bool) -> dict[str, Any]:
    """Fly and fit one replicate."""
    from bayeschute.likelihood.priors import working
    from bayeschute.posterior import joint_mode as optimum
    from bayeschute.posterior.fit.joint_fit import JointFit
    from bayeschute.posterior.fit.laplace_fit import find
    from bayeschute.posterior.fit.marginal_mode import marginal_mode
    from bayeschute.posterior.noise_uncertainty import joint_covariance
    from bayeschute.records.sensors import SensorNoise
    from bayeschute.study.assembly import assemble

    drop = assemble.drop(study.flights[0].virtual)
    if known:
        drop = replace(drop, sensors={**drop.sensors, "wind": SensorNoise()})
    flight, priors = flown(study, seed, drop)
    data = [flight]
    if known:
        hyper, truth = known_noise(drop), working(priors)[0]
        best = optimum.fit(data, hyper, priors, truth, tolerance=0.05)
        best = marginal_mode(data, priors, JointFit(best, hyper, np.nan))
        covariance = best.covariance
    else:
        found = find(data, priors, assemble.noise_prior(study))
        best = found.optimum
        covariance = joint_covariance(found.marginal.scale, found.noise_effect, found.noise_parameter_covariance)
    z = (best.theta - working(priors)[0]) / np.sqrt(np.diag(covariance))
    return {
        "seed": seed,
        "known": known,
        "converged": bool(best.converged),
        "z": {p.name: float(v) for p, v in zip(priors, z, strict=True)},
    }


def main() -> None:
    """Run, print the table, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/parameter-coverage.jsonl"))
    parser.add_argument("--replicates", type=int, default=20)
    parser.add_argument("--known", action="store_true", help="noise parameters known, wind recorded without error")
    given = parser.parse_args()
    from bayeschute.study.load import load_study

    study = load_study(STUDY)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    there = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    rows = {row["seed"]: row for row in there if row["known"] == given.known}
    for seed in range(1001, 1001 + given.replicates):
        if seed not in rows:
            rows[seed] = one(study, seed, given.known)
            with given.out.open("a") as file:
                file.write(json.dumps(rows[seed]) + "\n")
        shown = "  ".join(f"{name} {z:+.1f}" for name, z in rows[seed]["z"].items() if "[" in name)
        print(f"seed {seed}: {shown}{'' if rows[seed]['converged'] else '  NOT CONVERGED'}", flush=True)
    kept = [rows[seed] for seed in range(1001, 1001 + given.replicates)]
    names = [name for name in kept[0]["z"] if "[" in name]  # the risers' priors sit on the truth: not scored
    z = np.array([[row["z"][name] for name in names] for row in kept])
    inside = np.mean(np.abs(z) < 1.6449, axis=0)
    error = np.sqrt(0.9 * 0.1 / len(kept))
    print(f"{len(kept)} replicates, nominal 90 % intervals (binomial standard error {100 * error:.0f} %)")
    for name, column, share in zip(names, z.T, inside, strict=True):
        rms = np.sqrt(np.mean(column**2))
        print(f"  {name:28} inside {100 * share:3.0f} %   mean of z {column.mean():+.2f}   rms {rms:.2f}")
    coverage = dict(zip(names, map(float, inside), strict=True))
    print_result(given, coverage, {"replicates": len(kept), "known": given.known})


if __name__ == "__main__":
    main()
