"""Simulation-based calibration of the dumbbell and of the cluster with latent wind: are ranks of truths uniform?

Every replicate draws parameters and noise parameters from their priors, lets the model itself make the record, and
identifies it. Ranks of parameters and derived quantities must keep within bands that hold for all of them together with
95 %. The test tests itself: the same draws, moved by 0.3 posterior standard deviations, are a sampler broken on
purpose, which must fail. Rows are kept; the same command goes on where it was stopped.

With --posterior, truths come from the posterior of a fit to the template's own record, and record and replicate are
then fitted together (posterior simulation-based calibration): a test where the data are, not all over the priors.

    python benchmarks/ranks.py dumbbell --replicates 300 [--posterior] [--workers 2] [--store] [--json]
"""

from __future__ import annotations

import hashlib
import json
import sys
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of, print_result

from bayeschute.aero.coefficient import is_coefficient
from bayeschute.calibration import simulation_based as sbc
from bayeschute.calibration.campaign import run
from bayeschute.calibration.rank_tables import rank_lines, summarise_ranks
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.prediction.bands import quantities_of_states
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.provenance import provenance

sys.path.insert(0, str(Path(__file__).parent))
ROOT = Path(__file__).parents[1]
STORED = ROOT / "models" / "reference" / "calibration"
SEED = 50_000
LEVELS = 99
SPREAD = {"C_A0": 0.05, "C_Aalpha": 0.1, "alpha_0": 0.02, "C_Nalpha": 0.03, "C_Nalphadot": 0.1}
CLUSTER_SPREAD = {"axial[1]": 0.05, "axial[alpha^2]": 0.15, "transverse[e]": 0.03, "transverse[e*alpha^2]": 0.3}
LOG_SD = 0.3  # of the noise parameters
SHIFT = 0.3  # of the draws that are spoiled, in posterior standard deviations


def dumbbell() -> sbc.Template:
    """A planar swing of 90 s with unknown wind."""
    import dumbbell_recovery as swing

    from bayeschute.reduced.dumbbell_data import WIND, dumbbell_data
    from bayeschute.reduced.virtual_swing import fly_swing

    record, _ = fly_swing(swing.FIRST, swing.BASE, swing.AERO, 1)
    priors = tuple(Prior(n, v, SPREAD[n], False, "1", "Table 7.1-2") for n, v in swing.TRUTH.items())
    flight = dumbbell_data(record, swing.BASE, swing.AERO, priors, WIND)
    return sbc.Template(
        flight, priors, NoisePrior(swing.COLORED, LOG_SD),
        lambda data, x: sbc.swing_quantities(x[:, 4], x[:, 3], float(data.dt)),
    )  # fmt: skip


def cluster() -> sbc.Template:
    """The first 45 s of the default study's first flight, with the terms that it flies."""
    from dataclasses import replace

    import parameter_coverage as study_of

    from bayeschute.prediction.bands import opening
    from bayeschute.study.assembly import assemble
    from bayeschute.study.load import load_study

    def narrower(*given: Any) -> list[Any]:
        wide = study_of.priors_about(*given)
        return [replace(p, scale=CLUSTER_SPREAD.get(p.name, 0.05 if is_coefficient(p.name) else p.scale)) for p in wide]

    study = load_study(study_of.STUDY)
    flight, priors = study_of.flown(study, 1, priors=narrower)

    def quantities(data: Any, x: np.ndarray) -> dict[str, np.ndarray]:
        seen = quantities_of_states(data, x)
        return sbc.swing_quantities(seen["swing_angle"], seen["descent_rate"], float(data.dt))

    return sbc.Template(opening(flight, 45.0), priors, replace(assemble.noise_prior(study), log_sd=LOG_SD), quantities)


@lru_cache(maxsize=2)
def template(name: str) -> sbc.Template:
    """A template, made once a process."""
    return {"dumbbell": dumbbell, "cluster": cluster}[name]()


@lru_cache(maxsize=2)
def believed(name: str) -> sbc.Believed:
    """The posterior of a template's own record, fitted once a process; the same in every process."""
    return sbc.believe(template(name), SEED - 1)


def one(seed: int, name: str, posterior: bool) -> dict[str, Any]:
    """One row; a replicate that fails is counted."""
    try:
        start = believed(name) if posterior else None
        return {"seed": seed, **sbc.ranked(seed, template(name), LEVELS, shift=SHIFT, believed=start)}
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        return {"seed": seed, "ok": False, "error": f"{type(error).__name__}: {error}"}


def test(
    name: str, replicates: int, posterior: bool, out: Path, workers: int = 1, address: str | None = None
) -> dict[str, Any]:
    """Run the replicates that are missing, print the table, and give the result as it is stored.

    Args:
        name: Of the template.
        replicates: How many.
        posterior: Whether truths come from the posterior of the template's record.
        out: Folder for rows.
        workers: Local processes.
        address: Of a Dask scheduler, in place of local processes.
    """
    model = name + (".posterior" if posterior else "")
    what = json.dumps([model, SHIFT, LEVELS, SPREAD, CLUSTER_SPREAD, LOG_SD, numerics()])
    rows = run(
        partial(one, name=name, posterior=posterior),
        range(SEED, SEED + replicates),
        out / f"ranks.{model}.rows",
        hashlib.sha256(what.encode()).hexdigest(),
        workers,
        address,
        lambda share, words: print(f"\rranks.{model}: {words}   ", end="", flush=True),
    )
    result = summarise_ranks(rows, LEVELS, SHIFT)
    print("\n" + "\n".join(rank_lines(result)))
    command = f"python benchmarks/ranks.py {name} --replicates {replicates}" + " --posterior" * posterior
    return {
        "study": model.replace(".", ", from its "), "noise": "latent",
        "disturbance": "none: truths and data from the model itself", **result,
        **provenance(command),
    }  # fmt: skip


def main() -> None:
    """Run, print the table, store the result, and with ``--json`` print one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("model", choices=("dumbbell", "cluster"))
    parser.add_argument("--replicates", type=int, default=300)
    parser.add_argument("--posterior", action="store_true", help="truths from the posterior of the template's record")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/ranks"))
    parser.add_argument("--store", action="store_true", help=f"keep the result under {STORED.relative_to(ROOT)}")
    given = parser.parse_args()
    result = test(given.model, given.replicates, given.posterior, given.out, given.workers)
    if given.store:
        STORED.mkdir(parents=True, exist_ok=True)
        which = given.model + (".posterior" if given.posterior else "")
        (STORED / f"ranks.{which}.json").write_text(json.dumps(result, indent=1) + "\n")
    print_result(given, {"inside_band": float(result["passed"])}, result)


if __name__ == "__main__":
    main()
