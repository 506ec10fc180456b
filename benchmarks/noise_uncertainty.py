"""What uncertain noise parameters do to the parameters' standard deviations beyond the first order that is drawn.

Draws are made for held noise parameters and moved with drawn ones along a slope (`inference.law_slope`); their spread
about it stays that of the held ones. Here noise parameters are drawn from their Laplace law and weighed by their
evidence, and the flights linearised at the optimum tell the parameters' covariance for each. The table gives, by
parameter, the standard deviation with the mean of those covariances over that which is drawn; the slope's part is the
same in both. Above 1, intervals are too narrow by as much.

    python benchmarks/noise_uncertainty.py --out runs/noise --seeds 1 2 3 [--draws 200] [--json]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

STUDY = Path(__file__).parents[1] / "models" / "studies" / "cdt-3-11.toml"


def one(out: Path, seed: int, draws: int) -> tuple[dict[str, float], float]:
    """Fit the study's record from a seed (or take up that fit).

    Args:
        out: Folder of runs.
        seed: Of the study.
        draws: Noise parameters to draw, half of them mirrored.

    Returns:
        Ratios of standard deviations by parameter, and how many draws the weights are worth.
    """
    from bayeschute.inference.evidence import HyperPrior, from_vector, function_of, to_vector
    from bayeschute.inference.law_slope import added
    from bayeschute.inference.map import conditional
    from bayeschute.inference.priors import working
    from bayeschute.study import setup
    from bayeschute.study.fits import groups, load_fit
    from bayeschute.study.load import load_study
    from bayeschute.study.stages import Job, run_study

    run_study(STUDY, out / f"seed{seed}", until="fit", resume=True, seed=seed)
    job = Job(load_study(STUDY), out / f"seed{seed}", False, "", lambda *_: None)
    (group,) = groups(job)
    stored = load_fit(job, group)
    linear, gaps = ([getattr(a, key) for a in stored.marginal.along] for key in ("linear", "gap"))
    flights = stored.marginal.flights
    evidence = function_of(flights, linear, group.priors, HyperPrior(setup.hyper(job.study)), gaps)
    at, root = to_vector(stored.hyper), np.linalg.cholesky(stored.law_covariance)
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
    widened = added(np.eye(len(group.priors)), stored.law_slope, stored.law_covariance)
    mean = np.einsum("k,kij->ij", weight, np.array(covariances))
    ratio = np.sqrt(np.diag(mean + widened) / np.diag(stored.optimum.covariance + widened))
    return dict(zip([p.name for p in group.priors], ratio.tolist(), strict=True)), float(1.0 / (weight @ weight))


def main() -> None:
    """Print the table, and with ``--json`` one object as the last line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/noise"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    made: dict[int, dict[str, float]] = {}
    for seed in given.seeds:
        made[seed], worth = one(given.out, seed, given.draws)
        print(f"seed {seed}: {given.draws} draws of the noise parameters, worth {worth:.0f}", flush=True)
    rows: dict[str, Any] = {name: [made[seed][name] for seed in given.seeds] for name in made[given.seeds[0]]}
    print(f"{'standard deviation over that drawn':36}" + "".join(f"  seed {seed:<4}" for seed in given.seeds))
    for name, ratios in rows.items():
        print(f"{name:36}" + "".join(f"{ratio:11.3f}" for ratio in ratios))
    if given.json:
        ratios = {f"sd_{name}": float(np.mean(values)) for name, values in rows.items()}
        print(json.dumps({"ratios": ratios, "context": {"seeds": given.seeds, "draws": given.draws}}))


if __name__ == "__main__":
    main()
