"""What the shortcuts of the fast posterior cost: its draws are weighted by a density linearised anew at every point.

The default study's first flight is identified as a run would. Draws of the posterior are then weighted by
`bayeschute.inference.nested`, once with the noise parameters held (this judges the linear course and the polynomial of
the log determinant), once with noise parameters drawn as well (this judges how their uncertainty is added). The table
tells the Pareto shape k of the weights, their effective number, and how far they move means and standard deviations;
above k = 0.7 the last two mean nothing.

    python benchmarks/shortcuts.py [--draws 200] [--seed 1] [--json]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from parameter_coverage import STUDY, priors_about

from bayeschute.forecast.virtual import fly
from bayeschute.inference.evidence import HyperPrior
from bayeschute.inference.finding import Found, find
from bayeschute.inference.nested import Drawn, Nested, draw
from bayeschute.inference.posterior import sample
from bayeschute.inference.records import cluster_data
from bayeschute.samplers.doubt import pareto_k
from bayeschute.study import setup
from bayeschute.study.load import load_study

NAMES = ("noise parameters held", "noise parameters drawn")


def identified(path: Path, seed: int, progress: Any) -> tuple[Found, Nested]:
    """The fit of the study's first flight with the terms that it flies, and its nested density."""
    study = load_study(path)
    model, structure = setup.cluster(study.vehicle)
    record, _ = fly(setup.drop(study.flights[0].virtual), model, structure, seed)
    priors = priors_about(study, structure, model)
    blank = replace(model, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    latent = setup.latent(study, structure.canopies)
    data = cluster_data(record, blank, structure, priors, tuple(study.noise.channels()), latent)
    prior = HyperPrior(setup.hyper(study))
    found = find([data], priors, prior, progress=progress)
    return found, Nested(found, priors, prior)


def judged(nested: Nested, drawn: Drawn, progress: Any) -> dict[str, Any]:
    """Weights of draws, and what they say."""
    points = []
    for i, (theta, eta) in enumerate(zip(drawn.theta, drawn.eta, strict=True)):
        points.append(nested.log_density(theta, eta))
        progress((i + 1) / len(drawn.theta), "nested density")
    ratio = np.array([point.value for point in points]) - drawn.log_proposal
    known = np.isfinite(ratio)
    weight = np.exp(ratio[known] - ratio[known].max())
    weight /= weight.sum()
    theta = drawn.theta[known]
    mean, sd = theta.mean(axis=0), theta.std(axis=0)
    moved = weight @ theta
    spread = np.sqrt(weight @ (theta - moved) ** 2)
    return {
        "draws": int(known.sum()), "failed": int((~known).sum()), "k": pareto_k(ratio),
        "sd_log_weight": float(ratio[known].std()), "effective": float(1.0 / np.sum(weight**2)),
        "unsettled": float(max(point.unsettled for point in points)),
        "mean_moved_sd": float(np.max(np.abs(moved - mean) / sd)), "sd_ratio": (spread / sd).tolist(),
    }  # fmt: skip


def main() -> None:
    """Identify, weigh, print the table, and with ``--json`` one object as the last line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1, help="of the flight and the draws")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()

    def tell(share: float, words: str) -> None:
        print(f"\r{100 * share:3.0f} % {words:60}", end="", flush=True)

    found, nested = identified(STUDY, given.seed, tell)
    made = sample(found.marginal, "nuts", 4, 300, 500, given.seed, tell)
    xi, density = made.xi.reshape(-1, made.xi.shape[-1]), made.log_density.ravel()
    both = [draw(found, xi, density, given.draws, given.seed, held) for held in (True, False)]
    rows = {name: judged(nested, drawn, tell) for name, drawn in zip(NAMES, both, strict=True)}
    print(f"\n{'':24} {'k':>6} {'effective':>10} {'of':>5} {'sd of log w':>12} {'mean moved':>11} {'sd ratio':>16}")
    for name, row in rows.items():
        low, high = min(row["sd_ratio"]), max(row["sd_ratio"])
        print(
            f"{name:24} {row['k']:6.2f} {row['effective']:10.0f} {row['draws']:5} {row['sd_log_weight']:12.2f} "
            f"{row['mean_moved_sd']:8.2f} sd {low:8.2f} to {high:.2f}"
        )
    if given.json:
        ratios = {f"effective_{name.split()[-1]}": row["effective"] / row["draws"] for name, row in rows.items()}
        print(json.dumps({"ratios": ratios, "context": rows}))


if __name__ == "__main__":
    main()
