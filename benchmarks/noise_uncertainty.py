"""What uncertain noise parameters do to the parameters' standard deviations, beside what is drawn.

Draws are made for held noise parameters, stretched and moved with drawn ones by an expansion
(`posterior.noise_uncertainty`). Here noise parameters are drawn from their Laplace law, and the flights linearised at
the optimum tell the parameters' covariance for each. The table gives, by parameter, the standard deviation with the
mean of those covariances over that which is drawn: for draws as they are, for draws weighed by their evidence, and, as
it was without any stretching, for covariances held. The slope's part is the same in all. Above 1, intervals are too
narrow by as much.

    python benchmarks/noise_uncertainty.py --out runs/noise --seeds 1 2 3 [--draws 200] [--json]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of, print_result

STUDY = Path(__file__).parents[1] / "models" / "studies" / "cdt-3-11.toml"


def one(out: Path, seed: int, draws: int) -> tuple[dict[str, dict[str, float]], float]:
    """Fit the study's record from a seed (or take up that fit).

    Args:
        out: Folder of runs.
        seed: Of the study.
        draws: Noise parameters to draw, half of them mirrored.

    Returns:
        Ratios of standard deviations by case and parameter, and how many draws the weights are worth.
    """
    from bayeschute.likelihood.priors import working
    from bayeschute.posterior.joint_mode import conditional
    from bayeschute.posterior.noise_evidence import from_vector, function_of, to_vector
    from bayeschute.posterior.noise_uncertainty import NoiseEffect, joint_covariance
    from bayeschute.study.assembly import assemble
    from bayeschute.study.assembly.fits import groups, load_fit
    from bayeschute.study.job import Job
    from bayeschute.study.load import load_study
    from bayeschute.study.run.stages import run_study

    run_study(STUDY, out / f"seed{seed}", until="fit", resume=True, seed=seed)
    job = Job(load_study(STUDY), out / f"seed{seed}", False, "", lambda *_: None)
    (group,) = groups(job)
    stored = load_fit(job, group)
    linear, gaps = ([getattr(a, key) for a in stored.marginal.along] for key in ("linear", "mean_correction"))
    flights = stored.marginal.flights
    evidence = function_of(flights, linear, group.priors, assemble.noise_prior(job.study), gaps)
    at, root = to_vector(stored.hyper), np.linalg.cholesky(stored.noise_parameter_covariance)
    half = np.random.default_rng([seed, 21]).standard_normal((draws // 2, at.size))
    log_weight, covariances = [], []
    for z in np.concatenate([half, -half]):
        law = from_vector(at + root @ z, stored.hyper)
        matrix = np.diag(working(group.priors)[1] ** -2.0)
        for flight, lin in zip(flights, linear, strict=True):
            matrix = matrix + np.asarray(conditional(flight, law, lin).matrix)
        covariances.append(np.linalg.inv(matrix))
        log_weight.append(0.5 * z @ z - evidence(at + root @ z)[0])
    weight = np.exp(np.array(log_weight) - max(log_weight))
    weight /= weight.sum()
    effect, scale = stored.noise_effect, np.asarray(stored.marginal.scale)
    drawn = np.diag(joint_covariance(scale, effect, stored.noise_parameter_covariance))
    still = NoiseEffect.none(*effect.slope.shape)._replace(slope=effect.slope)
    held = joint_covariance(scale, still, stored.noise_parameter_covariance)
    slope = np.diag(held - scale @ scale.T)
    alike = np.full(draws, 1.0 / draws)
    made = {"as drawn": alike, "weighed": weight}
    variances = {name: np.einsum("k,kii->i", w, np.array(covariances)) + slope for name, w in made.items()}
    variances["held"] = np.diag(held)
    names = [p.name for p in group.priors]
    ratios = {name: dict(zip(names, np.sqrt(v / drawn).tolist(), strict=True)) for name, v in variances.items()}
    return ratios, float(1.0 / (weight @ weight))


def main() -> None:
    """Print the table, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/noise"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--draws", type=int, default=200)
    given = parser.parse_args()
    made: dict[str, list[dict[str, float]]] = {}
    for seed in given.seeds:
        cases, worth = one(given.out, seed, given.draws)
        print(f"seed {seed}: {given.draws} draws of the noise parameters, worth {worth:.0f} when weighed", flush=True)
        for case, ratios in cases.items():
            made.setdefault(case, []).append(ratios)
    for case, rows in made.items():
        print(f"{f'standard deviation over that drawn: {case}':48}" + "".join(f"  seed {s:<4}" for s in given.seeds))
        for name in rows[0]:
            print(f"{name:48}" + "".join(f"{row[name]:11.3f}" for row in rows))
    means: dict[str, Any] = {
        f"sd_{name}_{case.replace(' ', '_')}": float(np.mean([row[name] for row in rows]))
        for case, rows in made.items()
        for name in rows[0]
    }
    print_result(given, means, {"seeds": given.seeds, "draws": given.draws})


if __name__ == "__main__":
    main()
