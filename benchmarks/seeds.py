"""The default study over several seeds: are its intervals and bands as honest as they say?

For every seed the whole study is run (resumed where it already ran); pooled over seeds, the table tells the share of
true parameters inside their 90 % intervals and the share of held-out samples whose true swing angle and descent rate
lie inside the 90 % bands of the unseen flight. With ``--emcee`` the same posterior is also drawn with emcee, and the
largest difference of a mean is given in standard deviations.

    python benchmarks/seeds.py --out runs/seeds --seeds 1 2 3 4 5 [--emcee 1] [--json]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of, print_result

STUDY = Path(__file__).parents[1] / "models" / "studies" / "cdt-3-11.toml"


def one(out: Path, seed: int, quick: bool) -> dict[str, Any]:
    """Run (or resume) the study with a seed and read what the tables need."""
    from bayeschute.study.run.stages import run_study

    summary = run_study(STUDY, out / f"seed{seed}", resume=True, quick=quick, seed=seed)
    known = {name: p for name, p in summary["parameters"].items() if "truth" in p}
    inside = {name: p["q05"] <= p["truth"] <= p["q95"] for name, p in known.items()}
    unseen = {
        name: flight for name, flight in summary["coverage"].items() if "predict" in summary["flights"][name]["roles"]
    }
    bands = {q: [f[q]["truth"] for f in unseen.values()] for q in next(iter(unseen.values()))}
    return {
        "inside": inside,
        "z": {name: (p["mean"] - p["truth"]) / p["sd"] for name, p in known.items()},
        "bands": {q: float(np.mean(v)) for q, v in bands.items()},
        "rhat": max(p["rhat"] for p in summary["parameters"].values()),
        "ess": min(p["ess_bulk"] for p in summary["parameters"].values()),
        "wall_s": summary["sampling"]["wall"]["fit_s"],
    }


def against_emcee(out: Path, seed: int, quick: bool, draws: int, ensembles: int) -> dict[str, float]:
    """Means of the posterior by emcee minus those by NUTS, over the posterior standard deviations."""
    from bayeschute.posterior.sampler import sample
    from bayeschute.study.assembly import assemble
    from bayeschute.study.assembly.fits import groups, load_fit
    from bayeschute.study.job import Job
    from bayeschute.study.load import load_study

    study = load_study(STUDY)
    job = Job(assemble.smaller(study) if quick else study, out / f"seed{seed}", quick, "", lambda *_: None)
    group = groups(job)[0]
    stored = load_fit(job, group)
    made = sample(stored.marginal, "emcee", ensembles, 0, draws, seed)
    theta = np.asarray(stored.marginal.centre) + made.xi @ np.asarray(stored.marginal.scale).T
    ours, theirs = (t.reshape(-1, t.shape[-1]) for t in (stored.theta, theta))
    difference = (theirs.mean(axis=0) - ours.mean(axis=0)) / ours.std(axis=0)
    return {p.name: float(d) for p, d in zip(group.priors, difference, strict=True)}


def main() -> None:
    """Run, print the table, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/seeds"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--emcee", type=int, nargs="*", default=[], help="seeds whose posterior emcee draws too")
    parser.add_argument("--emcee-draws", type=int, default=300)
    parser.add_argument("--ensembles", type=int, default=2)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    rows = {}
    for seed in given.seeds:
        rows[seed] = row = one(given.out, seed, given.quick)
        hit, of = sum(row["inside"].values()), len(row["inside"])
        bands = "  ".join(f"{q} {100 * v:.0f} %" for q, v in row["bands"].items())
        print(f"seed {seed}: {hit} of {of} parameters inside 90 %; bands: {bands}")
        print(f"        R-hat {row['rhat']:.4f}, ESS {row['ess']:.0f}, fit {row['wall_s']:.0f} s")
        missed = [f"{name} (z {row['z'][name]:+.1f})" for name, ok in row["inside"].items() if not ok]
        if missed:
            print(f"        outside: {', '.join(missed)}")
    inside = [ok for row in rows.values() for ok in row["inside"].values()]
    pooled = {q: float(np.mean([row["bands"][q] for row in rows.values()])) for q in next(iter(rows.values()))["bands"]}
    share = float(np.mean(inside))
    error = float(np.sqrt(share * (1.0 - share) / len(inside)))
    print(
        f"pooled: {100 * share:.0f} +- {100 * error:.0f} % of {len(inside)} true parameters inside their 90 % intervals"
    )
    print("pooled bands of the unseen flight: " + ", ".join(f"{q} {100 * v:.0f} %" for q, v in pooled.items()))
    differences = {
        seed: against_emcee(given.out, seed, given.quick, given.emcee_draws, given.ensembles) for seed in given.emcee
    }
    for seed, table in differences.items():
        worst = max(table, key=lambda name: abs(table[name]))
        print(f"emcee against NUTS, seed {seed}: largest difference of a mean {table[worst]:+.2f} sd ({worst})")
    context = {"seeds": rows, "pooled_bands": pooled, "emcee_minus_nuts_sd": differences}
    print_result(given, {"parameter_coverage": share}, context)


if __name__ == "__main__":
    main()
