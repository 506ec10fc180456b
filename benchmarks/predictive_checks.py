"""Power of the predictive checks: how often do they notice a wrong model, and how often a sound one?

Every flight is a virtual drop like the first of the default study, from a seed, identified with the terms that it
flies, on a record with a mistake that the identification is not told. Cases: ``sound``; ``mass``, the capsule 5 %
heavier; ``wind``, the recorded wind off by 3 m/s; ``canopy``, the area of one canopy 10 % larger; ``white``, identified
with white noise and no disturbances; ``form``, identified with a normal force that is linear in the angle of attack;
``terms``, two more small aerodynamic terms. Rows are kept; the same command goes on. Cases are stored one by one, each
with what made it.

    python benchmarks/predictive_checks.py --flights 10 [--cases mass wind] [--duration 90] [--workers 2] [--store]
    python benchmarks/predictive_checks.py --page
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from calibration_page import _table as table
from scipy.stats import norm

from bayeschute.calibration.campaign import run
from bayeschute.core.errors import FitError
from bayeschute.dynamics.cluster_flight import ClusterFlight
from bayeschute.posterior.assess.alternatives import scores
from bayeschute.posterior.marginal import Marginal
from bayeschute.prediction.predictive_checks import BOUND, least, missed
from bayeschute.records.record import write_record
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import groups, load_fit
from bayeschute.study.assembly.missing_terms import missing_terms
from bayeschute.study.evidence.identity import with_noise
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.provenance import provenance
from bayeschute.study.evidence.record_misfit import misfit_of_fit
from bayeschute.study.evidence.scenarios import SCENARIOS
from bayeschute.study.job import Job
from bayeschute.study.load import load_study
from bayeschute.study.rank_tests import with_flown_terms
from bayeschute.study.run import stage_list
from bayeschute.study.study import Study
from bayeschute.virtual.drop import fly

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
STORED = ROOT / "models" / "reference" / "predictive-checks.json"
PAGE = ROOT / "docs" / "predictive-checks.md"
HEAVIER, LARGER, WIND = 1.05, 1.1, 3.0  # [1], [1], [m/s] towards north
MISTAKES = {
    "sound": "none",
    "mass": f"the capsule is {100 * HEAVIER - 100:.0f} % heavier than the vehicle says",
    "wind": f"the recorded wind is off by {WIND:g} m/s",
    "canopy": f"the area of one of the two canopies is {100 * LARGER - 100:.0f} % larger",
    "white": "identified with white noise and without disturbances",
    "form": "identified with a normal force linear in the angle of attack",
    "terms": "two small aerodynamic terms more fly: 0.3 alpha^3, -0.06 e*alpha",
}
CASES = tuple(MISTAKES)
LEFT_OUT = "transverse[e*alpha^2]"  # of what is identified in the case `form`
WANTED, MOST_FALSE = 0.9, 0.1  # share of the flights with a mistake that is noticed, and of sound ones that is flagged
SEED = 60_000
SHOWN = 5


def identified(study: Study, case: str) -> Study:
    """The study that identifies: its first flight, with the terms that are flown."""
    sampler = study.sampler.model_copy(update={"warmup": 100, "draws": 100})
    made = replace(with_flown_terms(study), sampler=sampler)
    if case == "form":
        assert made.structure is not None
        core = tuple(name for name in made.structure.core if name != LEFT_OUT)
        transverse = tuple(term for term in made.structure.transverse if f"transverse[{term}]" != LEFT_OUT)
        made = replace(made, structure=made.structure.model_copy(update={"core": core, "transverse": transverse}))
    return with_noise(made, "white") if case == "white" else made


def best_power(marginal: Marginal, study: Study, count: int) -> float:
    """Chance that the test of an added term itself would flag a flight, the better of the two: none has more.

    Args:
        marginal: The posterior of a flight of the case `terms`.
        study: The default study.
        count: Tests of the flight, by which the bound is shared.
    """
    (flight,), vehicles = marginal.flights, (SCENARIOS["form"].flown(study).vehicle, study.vehicle)
    flown, known = (dict(vehicle.aero.coefficients()) for vehicle in vehicles if vehicle is not None)
    sizes = {name: value for name, value in flown.items() if name not in known}
    library = {
        kind: [name[len(kind) + 1 : -1] for name in sizes if name.startswith(kind)] for kind in ("axial", "transverse")
    }
    assert isinstance(flight.model, ClusterFlight)
    tested = scores(marginal, 0, [alternative for _, alternative in missing_terms(flight, library)])
    least = norm.isf(BOUND / count / 2.0)
    by_name = {name: next(one.se for one in tested if name in one.what) for name in sizes}
    return float(max(norm.sf(least - abs(sizes[name]) / se) for name, se in by_name.items()))


def fly_case(study: Study, case: str, seed: int, duration: float, path: Path) -> None:
    """Fly a record with the mistake of a case, and store it."""
    flown = SCENARIOS["form"].flown(study) if case == "terms" else study
    flight = flown.flights[0]
    assert flown.vehicle is not None and flight.virtual is not None
    vehicle = flown.vehicle
    if case == "mass":
        capsule = vehicle.capsule.model_copy(update={"mass": HEAVIER * vehicle.capsule.mass})
        vehicle = vehicle.model_copy(update={"capsule": capsule})
    each = {name: np.array([LARGER, 1.0]) * value for name, value in vehicle.aero.coefficients().items()}
    model, structure = assemble.cluster(vehicle, flight.capsule_mass, each if case == "canopy" else {})
    virtual = flight.virtual.model_copy(update={"duration": duration})
    record, _ = fly(assemble.drop(virtual), model, structure, seed)
    if case == "wind":
        record["wind"] = record["wind"] + WIND * np.array([1.0, 0.0, 0.0])
    write_record(record, path)


def one(seed: int, case: str, duration: float) -> dict[str, Any]:
    """A row: the checks that were missed, and the smallest p-values; a fit that fails is counted."""
    study = load_study(STUDY)
    wanted = replace(identified(study, case), seed=seed)
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as folder:
        out = Path(folder)
        fly_case(study, case, seed, duration, out / "drop.nc")
        wanted = replace(wanted, flights=(replace(wanted.flights[0], virtual=None, path=out / "drop.nc"),))
        job = Job(wanted, out / "run", False, "", lambda *_: None)
        (out / "run").mkdir()
        try:
            for stage in (stage_list.ingest, stage_list.structure, stage_list.priors):
                stage(job)
            stage_list.fit(job, predictions=False)
            (group,) = groups(job)
            found = load_fit(job, group)
            checks = misfit_of_fit(job, group, found).checks
            power = {"power": best_power(found.marginal, study, len(checks))} if case == "terms" else {}
        except (FitError, FloatingPointError) as error:
            return {"seed": seed, "ok": False, "error": f"{type(error).__name__}: {error}"[:300]}
    return {
        "seed": seed, "ok": True, "flagged": bool(missed(checks)), "checks": len(checks),
        "missed": len(missed(checks)), "least": [c._asdict() for c in least(checks)[:SHOWN]], **power,
    }  # fmt: skip


def test(case: str, flights: int, duration: float, out: Path, workers: int) -> dict[str, Any]:
    """Fly the flights of a case that are missing, and count."""
    what = hashlib.sha256(json.dumps([case, duration, numerics()]).encode()).hexdigest()
    rows = run(
        partial(one, case=case, duration=duration),
        range(SEED, SEED + flights),
        out / f"{case}.rows",
        what,
        workers,
        progress=lambda share, words: print(f"{case}: {words}", flush=True),
    )
    good = [row for row in rows if row["ok"]]
    flagged = sum(row["flagged"] for row in good)
    first = [
        f"{row['least'][0]['statistic']} of {row['least'][0]['what']}, p = {row['least'][0]['p']:.1g}" for row in good
    ]
    print(f"{case}: {flagged} of {len(good)} flagged, {len(rows) - len(good)} fits failed; {'; '.join(first)}")
    failed = {str(row["seed"]): row["error"] for row in rows if not row["ok"]}
    power = [row["power"] for row in good if "power" in row]
    told = {"power": float(np.mean(power))} if power else {}
    return {"flights": len(good), "flagged": flagged, "failed": failed, "smallest": first, **told}


def page(result: dict[str, Any]) -> str:
    """docs/predictive-checks.md."""
    rows = []
    for case, one in result["cases"].items():
        flown, refused = one["flights"] + len(one["failed"]), len(one["failed"])
        share = (one["flagged"] + refused) / flown
        good = share <= MOST_FALSE if case == "sound" else share >= WANTED
        first = Counter(words.split(",")[0] for words in one["smallest"]).most_common(1)
        made = one["made"]
        rows.append((
            f"`{case}`", MISTAKES[case], str(flown), str(one["flagged"]), str(refused), "yes" if good else "**no**",
            first[0][0] if first else "–", f"{made['commit'][:7]}, {made['date'][:10]}, {made['numerics'][:8]}",
        ))  # fmt: skip
    power = result["cases"].get("terms", {}).get("power")
    most = (
        ""
        if power is None
        else f"""
Of `terms` no test can flag more: that of the very coefficient that was added, the most powerful there is, would flag
{100 * power:.0f} % of such flights at the same level.
"""
    )
    columns = (
        "case",
        "mistake",
        "flights",
        "flagged",
        "no fit",
        "as wanted",
        "most often the smallest p-value",
        "made by",
    )
    return f"""# What predictive checks notice

Written by `python benchmarks/predictive_checks.py --page`; do not edit. Numbers:
`models/reference/predictive-checks.json`; *made by*: commit, date (UTC), and the hash of the numerics.

Every flight is a virtual drop of {result["duration_s"]:g} s like the first of the default study, identified with the
terms that it flies, on a record with a mistake that the identification is not told. *flagged*: the check `predictive`
is missed, at {result["bound"]:g} over all statistics of a flight; *no fit*: no mode was found, which a run says, and
nothing is predicted. As wanted: {100 * WANTED:.0f} % of the flights with a mistake flagged or refused, and at most
{100 * MOST_FALSE:.0f} % of the sound ones.

{chr(10).join(table(columns, rows))}
{most}
Where a mistake is not noticed, parameters or latent disturbances follow it: what was fitted then does not speak for
another payload or vehicle. What bands of a predicted flight hold when such terms fly:
[calibration.md](calibration.md).
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases, print a line for each, and store the result with its provenance and its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=10, help="of every case; sound ones are twice as many")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--duration", type=float, default=90.0, help="of a flight [s]")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/predictive-checks"))
    parser.add_argument("--store", action="store_true", help=f"keep the result as {STORED.name}")
    parser.add_argument("--page", action="store_true", help="only write the page")
    given = parser.parse_args(arguments)
    if given.page:
        PAGE.write_text(page(json.loads(STORED.read_text(encoding="utf-8"))), encoding="utf-8")
        return
    counts = {case: given.flights * (2 if case == "sound" and given.flights > 1 else 1) for case in given.cases}
    results = {case: test(case, n, given.duration, given.out, given.workers) for case, n in counts.items()}
    if given.store:
        known = json.loads(STORED.read_text(encoding="utf-8"))["cases"] if STORED.is_file() else {}
        script = (
            f"python benchmarks/predictive_checks.py --flights {given.flights} --duration {given.duration:g} --store"
        )
        for case, one in results.items():
            known[case] = one | {"made": provenance(f"{script} --cases {case}")}
        cases = {case: known[case] for case in CASES if case in known}
        whole = {"bound": BOUND, "duration_s": given.duration, "cases": cases}
        STORED.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
        PAGE.write_text(page(whole), encoding="utf-8")


if __name__ == "__main__":
    main()
