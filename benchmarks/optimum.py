"""Does a fit find its optimum wherever it starts? Many starts drawn from the prior on the records of a run.

The whole library of terms of a cluster study is fitted to the records that its run has read, as `bayeschute fit` does,
from the prior means (start 0) and from draws from the whole prior. Noise parameters are found anew from every start.
Then all optima are compared as the product's multistart check does, under the noise parameters of the one of greatest
evidence: a start counts as found where every parameter lies within 0.1 standard errors of that optimum.

    bayeschute run STUDY --until priors --out RUN
    python benchmarks/optimum.py STUDY RUN [--starts 20] [--seed 1] [--store models/reference/starts] [--json]

``--store`` keeps the result in a file named after the study, for `evidence_page.py`.
"""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter
from typing import Any

from command import parser_of, print_result

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


def kept(study: Path, starts: int, seed: int, best: int, rows: list[dict[str, Any]], share: float) -> dict[str, Any]:
    """The result as it is stored, with what made it.

    Args:
        study: Its file.
        starts: How many.
        seed: Of the starts.
        best: Number of the start whose optimum has the greatest evidence.
        rows: Comparison of each other start's optimum with that.
        share: Of starts that found it.
    """
    from bayeschute.study.evidence.provenance import provenance

    told = provenance(f"benchmarks/optimum.py {study.name} RUN --starts {starts} --seed {seed}")
    made = {"study": study.stem, "starts": starts, "seed": seed, "best": best, "share_found": share, "rows": rows}
    return made | {"provenance": told}


def main() -> None:
    """Fit from all starts, print the table, and with ``--json`` one object as the last line."""
    from bayeschute.posterior.assess.multistart import NEAR, best_of, compare, judge, settle_from

    parser = parser_of(__doc__)
    parser.add_argument("study", type=Path)
    parser.add_argument("run", type=Path, help="folder of a run that has come to its priors")
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1, help="of the starts")
    parser.add_argument("--store", type=Path, metavar="DIR", help="keep the result there")
    given = parser.parse_args()
    flights, priors, prior = problem(given.study, given.run)
    tried = []
    for number in range(given.starts):
        began = perf_counter()
        start = settle_from(flights, priors, prior, number, given.seed, spread=1.0)
        told = start.why if start.settled is None else f"log evidence {-start.settled.evidence:.1f}"
        print(f"start {number}: {told}, {perf_counter() - began:.0f} s", flush=True)
        tried.append(start)
    best = best_of(tried)
    assert best.settled is not None
    rows = compare(flights, priors, best, [start for start in tried if start is not best])
    print(f"start {best.number}: greatest evidence")
    for row in rows:
        words = row.why or f"{row.away:.4f} standard errors off in {row.parameter}, cost {row.worse:+.3g}"
        print(f"start {row.number}: {words}{'' if row.converged else ', NOT CONVERGED'}")
    converged = best.settled.optimum.converged
    share = (converged + sum(row.converged and row.away <= NEAR for row in rows)) / given.starts
    print(judge(rows, converged).words)
    print(f"{share:.0%} of {given.starts} starts found the optimum ({'reached' if share >= WANTED else 'MISSED'})")
    plain = [row._asdict() for row in rows]
    if given.store:
        made = kept(given.study, given.starts, given.seed, best.number, plain, share)
        given.store.mkdir(parents=True, exist_ok=True)
        (given.store / f"{made['study']}.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    context = {"starts": given.starts, "seed": given.seed, "kept": best.number, "rows": plain}
    print_result(given, {"share_found": share}, context)


if __name__ == "__main__":
    main()
