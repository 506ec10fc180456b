"""Does a candidate drop teach what `land --also design` promises? The best and the worst are flown, and learnt from.

For each of the two, drops are flown whose parameters are drawn from the posterior (so that it is the truth's prior),
with gusts and sensors of their own; the posterior is updated by each record. What is left of the spread of P(met) of
the campaign's first requirement, through the same probit, and of each parameter's standard deviation, is averaged over
the drops and compared with the promise. Rows are kept; the same command goes on. ``--page`` writes docs/next-drop.md
from what is stored, without flying anything.

    python benchmarks/next_drop.py POSTERIOR [--campaign FILE] [--drops 12] [--out DIR] [--store] [--json]
    python benchmarks/next_drop.py --page
"""

from __future__ import annotations

import hashlib
import json
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from calibration_page import _table as table
from command import parser_of, print_result
from numpy.typing import NDArray
from scipy.special import ndtr

import bayeschute as bc
from bayeschute.api.landing.landing_verb import land, source_of
from bayeschute.calibration.campaign import run
from bayeschute.dynamics.cluster_flight import LOGARITHMIC
from bayeschute.landing.campaign_plan import Parameters
from bayeschute.landing.decisions.drop_value import Slope, probit_slope
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.provenance import provenance
from bayeschute.study.landing_campaign.campaign_file import Campaign, load_campaign
from bayeschute.study.landing_campaign.candidate_drops import Candidates, candidates, fly_candidate

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "models" / "campaigns" / "cdt-3-11-landing.toml"
STORED = ROOT / "models" / "reference" / "next-drop.json"
PAGE = ROOT / "docs" / "next-drop.md"
SEED = 80_000
WITHIN = 0.25
"""Of the promised shrinking."""


class Known(NamedTuple):
    """What is known before the drop: the posterior, its landings' probit, its draws, and the candidates."""

    posterior: bc.Posterior
    slope: Slope
    model: Parameters
    drops: Candidates


def spread(slope: Slope, centre: Array, theta: Array) -> float:
    """Standard deviation of P(met) over draws (D, P)."""
    return float(ndtr(slope.at_mean + (theta - centre) @ slope.slope).std())


def one(seed: int, known: Known, name: str) -> dict[str, Any]:
    """A drop flown with parameters drawn from the posterior, and what is left after it."""
    flight = next(f for f in known.drops.study.flights if f.name == name)
    theta, spec = known.model.theta, known.drops.study
    truth = theta[np.random.default_rng(seed).integers(len(theta))]
    like, priors = spec.with_role("identify")[0], known.posterior.as_priors().parameters
    record = fly_candidate(spec, flight, priors, like, truth, seed)
    drop = bc.Flight(record, spec.vehicle_of(flight), name=f"{name} {seed}", capsule_mass=flight.capsule_mass)
    try:
        after = known.posterior.update(drop, noise=known.drops.noise[name], draws=1000, chains=4, seed=seed)
    except bc.FitError as error:
        return {"seed": seed, "ok": False, "error": f"{type(error).__name__}: {error}"[:300]}
    columns = [after[n].values.ravel() for n in known.model.names]
    own = np.stack(
        [np.log(c) if n in LOGARITHMIC else c for n, c in zip(known.model.names, columns, strict=True)], axis=1
    )
    centre = theta.mean(axis=0)
    return {
        "seed": seed, "ok": True, "failed_checks": list(after.failed_checks),
        "spread": spread(known.slope, centre, own) / spread(known.slope, centre, theta),
        "probit": float((own @ known.slope.slope).std() / (theta @ known.slope.slope).std()),
        "left": dict(zip(known.model.names, (own.std(axis=0) / theta.std(axis=0)).tolist(), strict=True)),
        "distance": float(np.mean(((own.mean(axis=0) - truth) / own.std(axis=0)) ** 2)),
    }  # fmt: skip


def promised(campaign: Campaign, posterior: bc.Posterior, out: Path) -> tuple[Known, Any]:
    """What the campaign promises of each candidate, and what that rests on."""
    source = source_of(campaign, posterior.spec, posterior.files)
    landings = land(source, out / "landings")
    table, model, rows = landings.rank_drops().table, source.plan.models[0], landings.rows
    slope = probit_slope(model.theta, rows["draw"], landings.requirements[0].met(rows))
    assert campaign.tables.design is not None
    drops = candidates(campaign.path.parent / campaign.tables.design.candidates, posterior.spec)
    return Known(posterior, slope, model, drops), table


def told(name: str, rows: list[dict[str, Any]], row: Any) -> dict[str, Any]:
    """A candidate's promise beside what its drops left."""
    good = [r for r in rows if r["ok"]]
    left = np.array([(r["spread"], r["probit"], *r["left"].values()) for r in good])
    names = ("spread", "probit", *good[0]["left"])
    promise = (1.0 - row.shrinking, row.probit_sd_left, *(row[f"sd left of {n}"] for n in names[2:]))
    mean, error = left.mean(axis=0), left.std(axis=0, ddof=1) / np.sqrt(len(left))
    print(f"{name}: share left after {len(good)} drops ({len(rows) - len(good)} fits failed), and promised")
    for n, x, e, p in zip(names, mean, error, promise, strict=True):
        what = {"spread": "spread of P(met)", "probit": "sd of its probit"}.get(n, f"sd of {n}")
        print(f"    {what}: {x:.2f} ± {e:.2f}, promised {p:.2f}; shrinking {(1.0 - x) / (1.0 - p):.2f} of the promise")
    shares = {"left": mean, "standard_error": error, "promised": promise}
    made = {key: dict(zip(names, map(float, values), strict=True)) for key, values in shares.items()}
    off = float(np.mean([r["distance"] for r in good]))
    return {"candidate": name, "drops": len(good), "failed": len(rows) - len(good), "distance": off, **made}


def shrinking(one: dict[str, Any], of: str = "probit") -> float:
    """Share of the promised shrinking that was found."""
    return float((1.0 - one["left"][of]) / (1.0 - one["promised"][of]))


def ordered(found: list[dict[str, Any]]) -> bool:
    """Whether the best candidate taught more than the worst."""
    return all(found[0]["left"][of] < found[1]["left"][of] for of in ("probit", "spread"))


def page(result: dict[str, Any]) -> str:
    """The page, from a stored result."""
    parts = []
    for one in result["candidates"]:
        rows = []
        for name, left in one["left"].items():
            promise, error = one["promised"][name], one["standard_error"][name]
            told = {"spread": "spread of P(met)", "probit": "sd of its probit"}.get(name, f"sd of `{name}`")
            rows.append((told, f"{promise:.2f}", f"{left:.2f} ± {error:.2f}", f"{(1.0 - left) / (1.0 - promise):.2f}"))
        words = f"{one['drops']} drops were flown and fitted, {one['failed']} fits failed"
        lines = table(("share left of", "promised", "found", "shrinking"), rows)
        parts.append("\n".join([f"## {one['candidate']}", "", f"{words}.", "", *lines]))
    ranked = [
        (row["candidate"], f"{row['spread_expected']:.4f}", f"{row['shrinking']:.2f}", f"{row['probit_sd_left']:.2f}")
        for row in result["promised"]
    ]
    ranking = "\n".join(table(("candidate", "spread of P(met) expected", "shrinking", "sd of its probit left"), ranked))
    order = "as promised" if ordered(result["candidates"]) else "not as promised"
    within = "within" if all(abs(shrinking(one) - 1.0) <= WITHIN for one in result["candidates"]) else "not within"
    return f"""# What the next drop teaches: promised and found

Written by `python benchmarks/next_drop.py --page`; do not edit. Numbers: `models/reference/next-drop.json`, made by
`{result["command"]}`, commit {result["commit"][:12]}, {result["date"][:10]}.

The ranking of candidate drops ([landings](landing.md)) by the posterior of the default study. Drops of the best and
of the worst were flown with parameters drawn from it, and the posterior was updated by each record. *Shrinking*
is the share of the promised shrinking that was found; wanted of the sd of the probit, which a drop determines, is
within {100 * WITHIN:.0f} % of one. The spread of P(met) also depends on where the mean of the posterior goes, so that
some drops widen it: its mean over so few drops is known to the standard error in the tables only.

Order: {order}. Sizes: {within} {100 * WITHIN:.0f} %.

{ranking}

{chr(10).join(parts)}
"""


def main() -> None:
    """Rank, fly the best and the worst, compare, and store the result with its provenance."""
    parser = parser_of(__doc__)
    parser.add_argument("posterior", type=Path, nargs="?", help="from `Posterior.save`")
    parser.add_argument("--campaign", type=Path, default=CAMPAIGN)
    parser.add_argument("--drops", type=int, default=12, help="of each of the two")
    parser.add_argument("--out", type=Path, default=Path("runs/next-drop"), help="for rows and landings")
    parser.add_argument("--store", action="store_true", help=f"keep the result as {STORED.relative_to(ROOT)}")
    parser.add_argument("--page", action="store_true", help="only write the page")
    given = parser.parse_args()
    if given.page or given.posterior is None:
        PAGE.write_text(page(json.loads(STORED.read_text(encoding="utf-8"))), encoding="utf-8")
        return
    posterior, campaign = bc.Posterior.load(given.posterior), load_campaign(given.campaign)
    known, table = promised(campaign, posterior, given.out)
    print(table[["candidate", "spread_now", "spread_expected", "shrinking", "information"]].to_string(index=False))
    what = [numerics(), hashlib.sha256(given.posterior.read_bytes()).hexdigest(), given.campaign.read_text("utf-8")]
    found = []
    for _, row in table.iloc[[0, -1]].iterrows():
        name = row.candidate
        identity = hashlib.sha256(json.dumps([*what, name]).encode()).hexdigest()
        seeds, say = range(SEED, SEED + given.drops), partial(print, f"{name}:", flush=True)
        rows = run(
            partial(one, known=known, name=name), seeds, given.out / f"{name}.rows", identity, 1,
            progress=lambda share, words, say=say: say(words),
        )  # fmt: skip
        found.append(told(name, rows, row))
    ratios = {f["candidate"]: shrinking(f) for f in found}
    print(f"order {'as promised' if ordered(found) else 'NOT as promised'}; shrinking of the probit's sd: {ratios}")
    result = {"candidates": found, "promised": table.to_dict("records")}
    if given.store:
        command = f"python benchmarks/next_drop.py {given.posterior.name} --drops {given.drops} --store"
        whole = json.dumps(result | provenance(command), indent=1)
        STORED.write_text(whole + "\n", encoding="utf-8")
        PAGE.write_text(page(json.loads(whole)), encoding="utf-8")
    print_result(given, ratios, result)


if __name__ == "__main__":
    main()
