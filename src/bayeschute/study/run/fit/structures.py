"""Stacking of model structures: several structures, each fitted, weighted by leave-future-out predictive density."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from bayeschute.aero.coefficient import Coefficient, is_coefficient
from bayeschute.core.errors import FitError
from bayeschute.core.random import seed_of, stream
from bayeschute.likelihood.priors import Prior, from_equation_error, read_priors
from bayeschute.posterior.combine.model_average import TRAINING, counts, sequential_scores, weights
from bayeschute.posterior.fit.drawn_density import Sampled, sampled
from bayeschute.posterior.fit.joint_fit import JointFit, joint_fit
from bayeschute.posterior.fit.laplace_fit import marginal_fit
from bayeschute.posterior.marginal import Marginal
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.posterior.sampler import sample
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Group, data_of, save_fit
from bayeschute.study.assembly.fitted_terms import in_order
from bayeschute.study.job import Job, load_priors, part_of
from bayeschute.study.run.fit import checkpoint, several_starts

FILE = "fit/structures.json"
COUNTS = 0.01  # weight from which a structure must have converged
Say = Callable[[float, str], None]


class Candidate(NamedTuple):
    """A structure to be fitted.

    Attributes:
        terms: Terms by kind of force.
        share: Share of the replicates that select them, kinds as independent of each other; NaN if none does.
        priors: Of all parameters.
    """

    terms: dict[str, tuple[str, ...]]
    share: float
    priors: tuple[Prior, ...]


class _Option(NamedTuple):
    """Terms of one kind, their share of the replicates and the priors of their coefficients."""

    terms: tuple[str, ...]
    share: float
    priors: tuple[Prior, ...]


def _options(job: Job, kind: str, entry: dict[str, Any], base: Sequence[Prior]) -> list[_Option]:
    """Structures of one kind: the selected one first, then the others by their share, each set of terms once."""
    table, flights = job.study.priors, ", ".join(f.name for f in job.study.with_role("structure"))
    selected = tuple(row["term"] for row in entry["selected"])
    shares = {frozenset(s["terms"]): float(s["share"]) for s in entry["structures"]}
    own = tuple(p for p in base if (one := Coefficient.parse(p.name)) and one.kind == kind)
    found = [_Option(selected, shares.get(frozenset(selected), 0.0), own)]
    for one in sorted(entry["structures"], key=lambda s: -s["share"]):
        if frozenset(one["terms"]) in {frozenset(o.terms) for o in found}:
            continue
        rows = zip(one["terms"], one["estimate"], one["se"], strict=True)
        made = tuple(
            replace(
                from_equation_error(
                    str(Coefficient(kind, term)), value, se, table.inflation, table.floor, flight=flights
                ),
                saturation=entry.get("saturation"),
            )
            for term, value, se in rows
        )
        found.append(_Option(tuple(one["terms"]), float(one["share"]), made))
    return found


def candidates(job: Job) -> list[Candidate]:
    """The structure that equation error selected, then the others that its replicates select most often.

    Returns:
        As many as the study wants, fewer if the replicates contain fewer.
    """
    table = job.study.structure
    assert table is not None and table.stack is not None
    found, base = job.load("structure.json")["coefficients"], load_priors(job)
    rest = tuple(p for p in base if not is_coefficient(p.name))
    made = [Candidate({}, 1.0, ())]
    for kind, entry in found.items():
        made = [
            Candidate({**c.terms, kind: o.terms}, c.share * o.share, (*c.priors, *o.priors))
            for c in made
            for o in _options(job, kind, entry, base)
        ]
    ordered = [made[0], *sorted(made[1:], key=lambda c: -c.share)][: table.stack]
    return [c._replace(priors=tuple(in_order(job.study, [*c.priors, *rest]))) for c in ordered]


def _settled(job: Job, group: Group, prior: NoisePrior, say: Say) -> JointFit:
    kept = checkpoint.get_settled(job, group.name)
    if kept is not None and tuple(kept[0]) == group.priors:
        return kept[1]
    if job.study.sampler.starts is None:
        flights = [data_of(job, f, group.priors) for f in group.flights]
        settled = joint_fit(flights, group.priors, prior, progress=say)
    else:
        settled = several_starts.settled(job, group, prior, [None], say)
    checkpoint.put_settled(job, group.name, group.priors, settled, {})
    return settled


class _Fitted(NamedTuple):
    """A fitted structure: optimum, draws, log scores of the first part and the rest of the flights."""

    settled: JointFit
    drawn: Sampled
    first: np.ndarray
    later: np.ndarray
    converged: bool


def _kind(job: Job) -> str:
    return "nuts" if job.study.sampler.kind == "both" else job.study.sampler.kind


def _fitted(job: Job, group: Group, say: Say) -> _Fitted:
    """Fit, draw, store and score one structure."""
    prior, table = assemble.noise_prior(job.study), job.study.sampler
    settled = _settled(job, group, prior, lambda s, w: say(0.6 * s, w))
    flights = [data_of(job, f, group.priors) for f in group.flights]
    widen = job.study.noise.model == "latent"
    found = marginal_fit(flights, group.priors, prior, settled, lambda s, w: say(0.6 + 0.2 * s, w), widen)
    seed = seed_of(job.study.seed, "draws of a structure", group.name)
    drawn = checkpoint.get_draws(job, group.name, _kind(job))
    if drawn is None:
        tell = part_of(say, 0.8, 0.9)

        def sampler(marginal: Marginal) -> Draws:
            return sample(marginal, _kind(job), table.chains, table.warmup, table.draws, seed, tell)

        drawn = sampled(found, sampler, tell)
        checkpoint.put_draws(job, group.name, _kind(job), drawn)
    found, draws = drawn.of(found), drawn.draws
    save_fit(job, group, found, draws, widened(draws.xi, found.noise_effect, found.noise_parameter_covariance, seed))
    say(0.9, "leave-future-out scores")
    return _Fitted(settled, drawn, *sequential_scores(found.marginal), found.optimum.converged)


def fit_all(job: Job, group: Group, say: Say) -> list[str]:
    """Fit every structure, weigh them, and keep the best as if it alone had been fitted.

    Args:
        job: The run.
        group: The flights, with the priors of the selected structure.
        say: Progress callback: share done and words.

    Returns:
        Names of the fits.

    Raises:
        FitError: If no structure can be fitted; it contains the best trajectories of the first that has any.
        FloatingPointError: If none can be fitted, for another reason.
    """
    listed, fitted, why = candidates(job), dict[int, _Fitted](), dict[int, str]()
    names = [f"structure-{i + 1}" for i in range(len(listed))]
    farthest: FitError | None = None
    for i, one in enumerate(listed):

        def tell(share: float, words: str, i: int = i) -> None:
            say((i + share) / len(listed), f"structure {i + 1} of {len(listed)}: {words}")

        try:
            fitted[i] = _fitted(job, replace(group, name=names[i], priors=one.priors), tell)
        except FloatingPointError as error:
            why[i] = str(error)
        except FitError as error:
            why[i], farthest = str(error), farthest or error
    if not fitted:
        reason = f"{why[0]} (none of {len(listed)} structures could be fitted)"
        if farthest is not None:
            tried = [f"{names[i]}: {said}" for i, said in why.items()]
            raise FitError(reason, tried, farthest.paths, farthest.parameters)
        raise FloatingPointError(reason)
    rng = stream(job.study.seed, "bootstrap of the weights")
    made = weights(np.array([one.later for one in fitted.values()]), rng)
    place = {i: k for k, i in enumerate(fitted)}
    rows = []
    for i, one in enumerate(listed):
        row: dict[str, Any] = {"name": names[i], "terms": {k: list(t) for k, t in one.terms.items()}}
        row |= {"share": one.share, "priors": [p.__dict__ for p in one.priors], "weight": 0.0, "failed": why.get(i, "")}
        if i in fitted:
            k, own = place[i], fitted[i]
            row |= {"weight": made.weight[k], "score": made.score[k], "behind": made.behind[k]}
            row |= {"behind_se": made.behind_se[k], "log_evidence": own.first.sum() + own.later.sum()}
            row |= {"converged": own.converged}
        rows.append(row)
    job.save(FILE, [assemble.as_plain(r) | {"priors": r["priors"]} for r in rows])
    best = max(fitted, key=lambda i: made.weight[place[i]])
    checkpoint.put_settled(job, group.name, listed[best].priors, fitted[best].settled, {})
    checkpoint.put_draws(job, group.name, _kind(job), fitted[best].drawn)
    return names


def summary_rows(job: Job) -> list[dict[str, Any]]:
    """Structures and weights without priors, heaviest first; none where one structure is fitted."""
    rows = job.load(FILE) if (job.out / FILE).exists() else []
    return sorted(({k: v for k, v in r.items() if k != "priors"} for r in rows), key=lambda r: -r["weight"])


def members(job: Job, group: Group, draws: int) -> list[tuple[Group, int]]:
    """Fits that predict a group's flights, and how many of the draws each gives; the group's own where it is alone."""
    if not (job.out / FILE).exists():
        return [(group, draws)]
    rows = job.load(FILE)
    share = counts(np.array([r["weight"] for r in rows]), draws)
    made = [replace(group, name=r["name"], priors=tuple(read_priors(r["priors"]))) for r in rows]
    return [(one, int(n)) for one, n in zip(made, share, strict=True) if n > 0]


def note(rows: Sequence[dict[str, Any]]) -> list[str]:
    """A line for the report, from `summary_rows`."""
    if not rows:
        return []
    words = []
    for r in rows:
        terms = "; ".join(f"{kind} {', '.join(names)}" for kind, names in r["terms"].items())
        if r["failed"]:
            words.append(f"failed ({r['failed']}): {terms}")
        else:
            words.append(f"{r['weight']:.2f} ({r['behind']:+.1f} +- {r['behind_se']:.1f}): {terms}")
    return [
        f"Predictions are a stacked average of {len(rows)} model structures, with weights (in brackets: log score "
        f"after the first {100 * TRAINING:g} % of the record minus that of the best, and its standard error): "
        f"{' | '.join(words)}. The posterior is that of the structure with the largest weight."
    ]


def check(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The check ``structures``, from `summary_rows`."""
    lost = [r for r in rows if r["failed"] or (r["weight"] > COUNTS and not r["converged"])]
    return {
        "passed": not lost,
        "value": float(len(lost)),
        "bound": 0.0,
        "detail": f"number of the {len(rows)} structures that failed or, with a weight above {COUNTS:g}, did not "
        "converge",
    }
