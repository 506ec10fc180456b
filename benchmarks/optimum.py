"""Does a fit find its optimum wherever it starts? Many starts drawn from the prior on the records of a run.

The whole library of terms of a cluster study is fitted to the records that its run has read, as `bayeschute fit` does,
from the prior means (start 0) and from draws from the whole prior. Noise parameters are found anew from every start.
Then all optima are compared under those of the greatest evidence, since only then they are optima of one function: a
start counts as found where every parameter lies within 0.1 standard errors of the joint mode that is most probable or,
with ``--marginal``, within 0.5 posterior standard deviations of that start's mode of the marginal posterior, whose
search ends within 0.2 of it.

    bayeschute run STUDY --until priors --out RUN
    python benchmarks/optimum.py STUDY RUN [--starts 20] [--marginal] [--seed 1] [--json]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from bayeschute.core.errors import FitError

NEAR = {"joint": 0.1, "marginal": 0.5}  # standard errors
WANTED = 0.95  # share of starts


def problem(path: Path, folder: Path) -> tuple[list[Any], tuple[Any, ...], Any]:
    """Flights, priors of the whole library and priors of the noise parameters of a study and its run."""
    from bayeschute.likelihood.priors import Prior
    from bayeschute.posterior.noise_evidence import NoisePrior
    from bayeschute.study.assembly import assemble
    from bayeschute.study.assembly.fits import data_of
    from bayeschute.study.job import Job
    from bayeschute.study.load import load_study

    study = load_study(path)
    job = Job(study, folder, False, "", lambda *_: None)
    priors = tuple(Prior(**entry) for entry in job.load("priors.json"))
    flights = [data_of(job, flight, priors) for flight in study.with_role("identify")]
    return flights, priors, NoisePrior(assemble.hyper(study))


def joint_from(flights: Sequence[Any], priors: Sequence[Any], prior: Any, number: int, seed: int) -> Any:
    """The joint fit of a start, its noise parameters with it."""
    from bayeschute.likelihood.priors import factor, working
    from bayeschute.posterior.fit.joint_fit import joint_fit

    centre, rng = working(priors)[0], np.random.default_rng([seed, number])
    if number == 0:
        return joint_fit(flights, priors, prior)
    theta = centre + factor(priors) @ rng.standard_normal(centre.size)
    return joint_fit(flights, priors, prior, begin=(theta, None, prior.median))


def settled(flights: Sequence[Any], priors: Sequence[Any], fit: Any, hyper: Any, marginal: bool) -> Any:
    """The optimum to which a joint fit leads under given noise parameters."""
    from bayeschute.posterior.fit.joint_fit import joint
    from bayeschute.posterior.fit.marginal_mode import marginal_mode

    if marginal:
        return marginal_mode(flights, priors, fit._replace(hyper=hyper))
    return joint(flights, hyper, priors, fit.optimum.theta, fit.optimum.flights)


def rows_of(fits: Mapping[int, Any], found: Mapping[int, Any], marginal: bool) -> list[dict[str, Any]]:
    """Distance of every optimum from the best, in its standard errors, with the costs of both."""
    value = {n: fits[n].evidence if marginal else one.cost for n, one in found.items() if one.converged}
    if not value:
        raise SystemExit("no start converged")
    best = found[min(value, key=lambda n: value[n])]
    se = np.sqrt(np.diag(best.covariance))
    return [
        {"start": n, "converged": bool(one.converged), "cost": float(one.cost),
         "evidence": float(-fits[n].evidence), "away": float(np.max(np.abs(one.theta - best.theta) / se))}
        for n, one in found.items()
    ]  # fmt: skip


def main() -> None:
    """Fit from all starts, print the table, and with ``--json`` one object as the last line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path)
    parser.add_argument("run", type=Path, help="folder of a run that has come to its priors")
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--marginal", action="store_true", help="go on to the mode of the marginal posterior")
    parser.add_argument("--seed", type=int, default=1, help="of the starts")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    flights, priors, prior = problem(given.study, given.run)
    fits, found, failed = {}, {}, {}
    for number in range(given.starts):
        began = perf_counter()
        try:
            fits[number] = joint_from(flights, priors, prior, number, given.seed)
            told = f"log evidence {-fits[number].evidence:.1f}"
        except (FitError, FloatingPointError) as error:
            failed[number] = told = str(error)
        print(f"start {number}: {told}, {perf_counter() - began:.0f} s", flush=True)
    if not fits:
        raise SystemExit("no start led anywhere")
    hyper = min(fits.values(), key=lambda fit: fit.evidence).hyper
    for number, fit in fits.items():
        began = perf_counter()
        try:
            found[number] = settled(flights, priors, fit, hyper, given.marginal)
        except (FitError, FloatingPointError) as error:
            failed[number] = str(error)
            continue
        words = "converged" if found[number].converged else "NOT CONVERGED"
        print(f"start {number}: {words}, cost {found[number].cost:.3f}, {perf_counter() - began:.0f} s", flush=True)
    kind = "marginal" if given.marginal else "joint"
    rows = rows_of(fits, found, given.marginal)
    for row in rows:
        print(f"start {row['start']}: {row['away']:.4f} standard errors from the best")
    count = sum(row["converged"] and row["away"] <= NEAR[kind] for row in rows)
    share = count / given.starts
    verdict = "reached" if share >= WANTED else "MISSED"
    print(f"{count} of {given.starts} starts within {NEAR[kind]:g} standard errors of one {kind} mode ({verdict})")
    if given.json:
        context = {"starts": given.starts, "mode": kind, "failed": failed, "rows": rows, "seed": given.seed}
        print(json.dumps({"ratios": {"share_found": share}, "context": context}))


if __name__ == "__main__":
    main()
