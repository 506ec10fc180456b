"""Does a fit find its mode wherever it starts? Many starts drawn from the prior on the records of a run.

The model that a run has fitted is fitted to its records anew, as `bayeschute fit` does: from the prior means (start 0)
and from draws from the whole prior, along the path of the record, with the noise parameters found anew from every
start. From where that leads each goes on to the mode of the marginal posterior, all under the run's noise parameters,
so that it is the mode of one density. A start counts as found where its search converged and every parameter lies
within 0.3 posterior standard deviations of the run's mode: a search ends where its next step would be shorter than 0.2.

    bayeschute run STUDY --until fit --out RUN
    python benchmarks/optimum.py STUDY RUN [--starts 20] [--seed 1] [--first 10] [--store DIR] [--json]

Every row is kept in the run's folder as it comes, so that a stop costs one start and a second process, begun with
``--first``, does the other half. ``--store models/reference/starts`` keeps the result in a file named after the study,
for `evidence_page.py`.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from command import parser_of, print_result

if TYPE_CHECKING:
    from bayeschute.posterior.assess.multistart import Told

WANTED = 0.95  # share of starts
NEAR = 0.3  # posterior standard deviations


def found(row: Told) -> bool:
    """Whether a start came to the run's mode."""
    return row.converged and row.away <= NEAR


class Problem(NamedTuple):
    """Flights, priors of the parameters and of the noise parameters; noise parameters, mode and key of a run's fit."""

    flights: list[Any]
    priors: tuple[Any, ...]
    prior: Any
    hyper: Any
    optimum: Any
    key: str


def problem(path: Path, folder: Path) -> Problem:
    """Of a study and its run, which has come to its fit."""
    from bayeschute.study.assembly import assemble
    from bayeschute.study.assembly.fits import data_of, groups, load_noise_parameters, load_optimum
    from bayeschute.study.evidence.numerics_hash import numerics
    from bayeschute.study.job import Job
    from bayeschute.study.load import load_study

    study = load_study(path)
    job = Job(study, folder, False, "", lambda *_: None)
    (group,) = groups(job)
    flights = [data_of(job, flight, group.priors) for flight in group.flights]
    hyper, best = load_noise_parameters(job, group), load_optimum(job, group)
    key = f"{numerics()} {(folder / '.stages' / 'fit').read_text(encoding='utf-8').strip()}"
    return Problem(flights, group.priors, assemble.noise_prior(study), hyper, best, key)


def row_of(file: Path, key: str) -> Told | None:
    """A row as it was kept; None where there is none, or it is of another fit or other numerics."""
    from bayeschute.posterior.assess.multistart import Told

    if not file.is_file():
        return None
    held = json.loads(file.read_text(encoding="utf-8"))
    return Told(**held["row"]) if held["key"] == key else None


def modes(given: Problem, starts: int, seed: int, folder: Path, first: int = 0) -> list[Told]:
    """Where starts lead.

    Args:
        given: The problem.
        starts: How many.
        seed: Of the draws.
        folder: Where each row is kept as it comes; rows of this fit that these numerics have left are not made again.
        first: The start to begin with; those before it come last.

    Returns:
        Of every start its distance from the run's mode [posterior standard deviations], by how much the log density is
        less there, and minus the log evidence of the noise parameters that it found.
    """
    from bayeschute.core.files import write_whole
    from bayeschute.posterior.along_record.conditional_mode import conditional_optimum
    from bayeschute.posterior.assess.multistart import Told, settle_from
    from bayeschute.posterior.fit.joint_fit import JointFit
    from bayeschute.posterior.fit.marginal_mode import marginal_mode

    def mode(place: JointFit) -> tuple[Any, float]:
        there = marginal_mode(given.flights, given.priors, place)
        rest = conditional_optimum(given.flights, given.hyper, given.priors, there.theta, there.flights)
        return there, np.nan if rest is None else rest.marginal

    kept, least = mode(JointFit(given.optimum, given.hyper, np.nan))
    scale = np.sqrt(np.diag(kept.covariance))
    rows = {}
    for number in [*range(first, starts), *range(first)]:
        file = folder / f"seed-{seed}-start-{number}.json"
        before = row_of(file, given.key)
        if before is not None:
            rows[number] = before
            continue
        began = perf_counter()
        start = settle_from(given.flights, given.priors, given.prior, number, seed, spread=1.0)
        row = Told(number, start.why, False, np.nan, np.nan, "", np.nan)
        if start.settled is not None:
            try:
                there, minus = mode(start.settled._replace(hyper=given.hyper))
                off = np.abs(there.theta - kept.theta) / scale
                far, evidence = int(np.argmax(off)), start.settled.evidence
                name = given.priors[far].name
                row = Told(number, "", there.converged, evidence, float(off[far]), name, minus - least)
            except FloatingPointError as error:
                row = row._replace(why=str(error))
        words = row.why or f"{row.away:.3f} standard deviations off in {row.parameter}, log density {-row.worse:+.3g}"
        told = "" if row.converged else ", NOT CONVERGED"
        print(f"start {number}: {words}{told}, {perf_counter() - began:.0f} s", flush=True)
        held = json.dumps({"row": row._asdict(), "key": given.key})
        write_whole(file, partial(Path.write_text, data=held, encoding="utf-8"), shared=True)
        rows[number] = row
    return [rows[number] for number in range(starts)]


def kept(study: Path, seed: int, rows: list[Told]) -> dict[str, Any]:
    """The result as it is stored, with what made it.

    Args:
        study: Its file.
        seed: Of the starts.
        rows: One for each start.
    """
    from bayeschute.study.evidence.provenance import provenance

    told = provenance(f"benchmarks/optimum.py {study.name} RUN --starts {len(rows)} --seed {seed}")
    share = sum(map(found, rows)) / len(rows)
    made = {"study": study.stem, "starts": len(rows), "seed": seed, "near": NEAR, "share_found": share}
    return made | {"rows": [row._asdict() for row in rows], "provenance": told}


def main() -> None:
    """Fit from all starts, print where each led, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("study", type=Path)
    parser.add_argument("run", type=Path, help="folder of a run that has come to its fit")
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1, help="of the starts")
    parser.add_argument("--first", type=int, default=0, help="the start to begin with; those before it come last")
    parser.add_argument("--store", type=Path, metavar="DIR", help="keep the result there")
    given = parser.parse_args()
    if not 0 <= given.first < given.starts:
        parser.error(f"--first is one of the {given.starts} starts, from 0; got {given.first}")
    rows = modes(problem(given.study, given.run), given.starts, given.seed, given.run / "starts", given.first)
    made = kept(given.study, given.seed, rows)
    share = made["share_found"]
    reached = "reached" if share >= WANTED else "MISSED"
    print(f"{sum(map(found, rows))} of {given.starts} starts found the mode ({reached})")
    if given.store:
        given.store.mkdir(parents=True, exist_ok=True)
        (given.store / f"{made['study']}.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    print_result(given, {"share_found": share}, {key: made[key] for key in ("starts", "seed", "rows")})


if __name__ == "__main__":
    main()
