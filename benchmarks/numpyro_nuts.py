"""numpyro's own NUTS on the marginal posterior of a run, beside the draws of `sample`: cost of a gradient, agreement.

    python benchmarks/numpyro_nuts.py RUN [--study STUDY] [--warmup 60] [--draws 100] [--chains 2] [--json]

A simulation is one of the whole record by machine code; the gradient is that of the compiled log likelihood.
Differences of means are in standard deviations of `sample`, and standard deviations as ratios; their Monte Carlo errors
are beside.
"""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter
from typing import Any

import arviz_stats
import jax
import numpy as np
import xarray as xr
from command import parser_of
from numpyro.infer import MCMC, NUTS, init_to_value

import bayeschute as bc
from bayeschute.likelihood.joint import states
from bayeschute.posterior.numpyro_model import log_likelihood, model, start


def seconds(call: Any, times: int = 20) -> float:
    """Median seconds of a call."""
    clock = []
    for _ in range(times):
        begun = perf_counter()
        jax.block_until_ready(call())
        clock.append(perf_counter() - begun)
    return float(np.median(clock))


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = parser_of(__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--study", type=Path)
    parser.add_argument("--warmup", type=int, default=60)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--chains", type=int, default=2)
    asked = parser.parse_args()
    posterior = bc.Run(asked.run, bc.Study.load(asked.study or asked.run / "study.toml")).posterior
    ((marginal, priors),) = posterior.marginals
    theta = np.asarray(marginal.centre)
    gradient = jax.jit(jax.value_and_grad(log_likelihood(marginal)))
    begun = perf_counter()
    jax.block_until_ready(gradient(theta))
    compiled = perf_counter() - begun
    flight, at = marginal.flights[0], marginal.along[0].at.latent_path(marginal.flights[0])
    found: dict[str, Any] = {"compiled_s": compiled, "gradient_s": seconds(lambda: gradient(theta))}
    found["simulation_s"] = seconds(lambda: states(flight, theta, at._replace(path=None)))
    found["gradient_over_simulation"] = found["gradient_s"] / found["simulation_s"]
    names, scale = tuple(p.name for p in priors), np.asarray(marginal.scale)
    kernel = NUTS(
        model(marginal, priors), init_strategy=init_to_value(values=start(marginal, priors)), dense_mass=[names],
        inverse_mass_matrix={names: scale @ scale.T}, adapt_mass_matrix=False, max_tree_depth=6,
    )  # fmt: skip
    mcmc = MCMC(kernel, num_warmup=asked.warmup, num_samples=asked.draws, num_chains=asked.chains,
                chain_method="sequential", progress_bar=False)  # fmt: skip
    begun = perf_counter()
    mcmc.run(jax.random.PRNGKey(0))
    found["nuts_s"] = perf_counter() - begun
    held = posterior.data["conditional"] if "conditional" in posterior.data.children else posterior.data["posterior"]
    rows = {}
    for name, drawn in mcmc.get_samples(group_by_chain=True).items():
        if name not in held.data_vars:
            continue
        one, other = np.asarray(drawn), held[name].values
        ess = float(arviz_stats.ess(xr.DataArray(one, dims=("chain", "draw"))))
        rows[name] = {
            "mean_difference": float((one.mean() - other.mean()) / other.std()),
            "mean_error": float(ess**-0.5),
            "sd_ratio": float(one.std() / other.std()),
            "sd_error": float((2.0 * ess) ** -0.5),
            "ess": ess,
        }
    found["parameters"] = rows
    if asked.json:
        print(json.dumps(found, indent=1))
        return
    print(f"compiled in {compiled:.1f} s; NUTS took {found['nuts_s']:.0f} s")
    print(f"gradient {1e3 * found['gradient_s']:.1f} ms, simulation {1e3 * found['simulation_s']:.1f} ms")
    for name, row in rows.items():
        print(f"{name:28} mean {row['mean_difference']:+.2f} +- {row['mean_error']:.2f} sd, "
              f"sd ratio {row['sd_ratio']:.2f} +- {row['sd_error']:.2f}, ESS {row['ess']:.0f}")  # fmt: skip


if __name__ == "__main__":
    main()
