"""Reference posteriors: exact importance sampling of everything unknown, and the default inference beside it.

``--make`` draws parameters and noise parameters about what the default inference found, weighs every draw by an
unbiased estimate of its exact joint density (`bayeschute.posterior.assess.exact_importance`), and keeps moments and
quantiles under
models/reference/posteriors. Nothing that makes the default inference fast is in those weights: no marginal mode, no
parabola of the determinant, no surrogate, no noise parameters held, no linear shift for their uncertainty. Without
``--make`` the default inference is run and compared with what is kept.

    python benchmarks/reference_posteriors.py dumbbell cluster-ar1 cluster-latent [--make] [--draws 3000] [--json]
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from command import parser_of, print_result

import bayeschute
from bayeschute.likelihood.joint import FlightData
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.assess import exact_importance
from bayeschute.posterior.assess.exact_importance import Following, Weighed
from bayeschute.posterior.fit.laplace_fit import LaplaceFit, find
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.posterior.sampler import sample

sys.path.insert(0, str(Path(__file__).parent))
STORED = Path(__file__).parents[1] / "models" / "reference" / "posteriors"
SEED = 11
OURS = 4000  # draws per chain of the default inference: chance adds little to what is compared
PILOTS, PILOT = 5, 10  # how many pilots at most; the run is this many times as long as one of them
GOOD = 0.15  # share of effective draws of a pilot whose proposal is good enough
LIMITS = {"mean": 0.1, "sd": 0.05, "q05": 0.15, "q95": 0.15}  # in reference sds; of the sd, its ratio less one


@dataclass(frozen=True)
class Case:
    """A flight and what is believed before."""

    flight: FlightData
    priors: tuple[Prior, ...]
    noise: NoisePrior


def ranked(name: str) -> Case:
    """The dumbbell of Table 7.1-2, or the default study's cluster, with latent wind and the priors of its rank test."""
    import ranks

    made = ranks.template(name)
    return Case(made.flight, made.priors, made.noise)


def cluster_ar1() -> Case:
    """The default study's first flight with the terms that it flies, no latent disturbances, AR(1) noise."""
    import parameter_coverage as study_of

    from bayeschute.study.assembly import assemble
    from bayeschute.study.evidence.identity import with_noise
    from bayeschute.study.load import load_study

    study = with_noise(load_study(study_of.STUDY), "ar1")
    flight, priors = study_of.flown(study, SEED)
    return Case(flight, priors, assemble.noise_prior(study))


CASES: dict[str, Callable[[], Case]] = {
    "dumbbell": lambda: ranked("dumbbell"),
    "cluster-ar1": cluster_ar1,
    "cluster-latent": lambda: ranked("cluster"),
}


def ours(case: Case) -> tuple[LaplaceFit, np.ndarray]:
    """The default inference: what was found, and draws of the parameters, working coordinates (S, P)."""
    found = find([case.flight], case.priors, case.noise)
    xi = sample(found.marginal, "nuts", 4, 300, OURS, SEED).xi
    wide = widened(xi, found.noise_effect, found.noise_parameter_covariance, SEED).reshape(-1, len(case.priors))
    return found, np.asarray(found.marginal.centre) + wide @ np.asarray(found.marginal.scale).T


def told(draws: np.ndarray, weight: np.ndarray | None = None) -> dict[str, float]:
    """What is compared, of the draws (S,) of one parameter."""
    w = np.full(len(draws), 1.0 / len(draws)) if weight is None else weight
    mean, order = float(w @ draws), np.argsort(draws)
    low, high = np.interp([0.05, 0.95], np.cumsum(w[order]) - 0.5 * w[order], draws[order])
    return {"mean": mean, "sd": float(np.sqrt(w @ (draws - mean) ** 2)), "q05": float(low), "q95": float(high)}


def make(name: str, case: Case, found: LaplaceFit, draws: int) -> dict[str, Any]:
    """Pilots, the first about what was found, others about the weighed moments of the last where need be; the run."""
    began = perf_counter()

    def weigh(proposal: Following, count: int, seed: int) -> Weighed:
        def tell(share: float, words: str) -> None:
            print(f"\r{name}: {words}, {(perf_counter() - began) / 60.0:.1f} min   ", end="", flush=True)

        made = exact_importance.weigh(found, case.priors, case.noise, proposal, count, seed, progress=tell)
        print(f"\n  {made.effective:.0f} effective draws, Pareto k {made.pareto_k:.2f}")
        return made

    proposal = exact_importance.laplace(found)
    for pilot in range(PILOTS):
        made = weigh(proposal, draws // PILOT, SEED + pilot)
        if made.effective > GOOD * len(made.theta):
            break
        proposal = exact_importance.improved(found, proposal, made)
    main = weigh(proposal, draws, SEED + PILOTS)
    return {
        "case": name, "seed": SEED, "draws": draws, "effective_draws": main.effective, "pareto_k": main.pareto_k,
        "scatter": float(np.nanmedian(main.scatter)), "last_move": float(np.nanmax(main.moved)),
        "failed": main.failed, "folded": main.folded, "minutes": (perf_counter() - began) / 60.0,
        "parameters": {p.name: told(main.theta[:, i], main.weight) for i, p in enumerate(case.priors)},
        "log_noise_parameters": [told(column, main.weight) for column in main.log_noise.T],
        "version": bayeschute.__version__,
    }  # fmt: skip


def compared(reference: dict[str, Any], theta: np.ndarray, priors: tuple[Prior, ...]) -> dict[str, dict[str, float]]:
    """By parameter, how far draws (S, P) are from the reference, in its sds; of the sd, its ratio less one."""
    rows = {}
    for i, prior in enumerate(priors):
        there, here = reference["parameters"][prior.name], told(theta[:, i])
        off = {key: (here[key] - there[key]) / there["sd"] for key in ("mean", "q05", "q95")}
        rows[prior.name] = off | {"sd": here["sd"] / there["sd"] - 1.0}
    return rows


def main() -> None:
    """Make references, or compare with them, and with ``--json`` print one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("cases", nargs="*", default=list(CASES), metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--make", action="store_true", help="draw and weigh, and keep the result")
    parser.add_argument("--draws", type=int, default=3000, help="weighed draws of --make (3000)")
    given = parser.parse_args()
    if unknown := sorted({*given.cases} - {*CASES}):
        parser.error(f"no case {', '.join(unknown)}: {', '.join(CASES)}")
    ratios: dict[str, float] = {}
    for name in given.cases:
        case, path = CASES[name](), STORED / f"{name}.json"
        if not (given.make or path.exists()):
            parser.error(f"{path} is not there: --make makes it")
        found, theta = ours(case)
        if given.make:
            STORED.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(make(name, case, found, given.draws), indent=1) + "\n", encoding="utf-8")
        reference = json.loads(path.read_text(encoding="utf-8"))
        rows = compared(reference, theta, case.priors)
        size = reference["effective_draws"]
        print(f"{name}: {size:.0f} effective draws, differences in sds of the reference")
        one = size**-0.5
        print(f"  its own standard errors: mean {one:.2f}, quantiles {2.1 * one:.2f}, sd {0.71 * one:.2f}")
        print(f"  {'':28}    mean      5 %     95 %   sd ratio")
        for parameter, row in rows.items():
            print(f"  {parameter:28} {row['mean']:+8.3f} {row['q05']:+8.3f} {row['q95']:+8.3f} {1.0 + row['sd']:10.3f}")
        kept = {key: sum(abs(row[key]) <= limit for row in rows.values()) for key, limit in LIMITS.items()}
        print("  within " + ", ".join(f"{LIMITS[key]} in {key}: {n} of {len(rows)}" for key, n in kept.items()))
        for key in LIMITS:
            ratios[f"{name}_worst_{key}"] = max(abs(row[key]) for row in rows.values())
    print_result(given, ratios, {"limits": LIMITS})


if __name__ == "__main__":
    main()
