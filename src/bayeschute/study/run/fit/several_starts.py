"""Multistart optimisation of a fit: each start is checkpointed, then the optima are compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bayeschute.core.random import seed_of
from bayeschute.posterior.assess.multistart import NEAR, Start, best_of, compare, judge, settle_from
from bayeschute.posterior.fit.joint_fit import Begin, JointFit, joint_fit
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import Group, data_of
from bayeschute.study.job import Job
from bayeschute.study.run.fit import checkpoint


def settled(
    job: Job, group: Group, prior: NoisePrior, begins: Sequence[Begin | None], say: Callable[[float, str], None]
) -> JointFit:
    """The joint optimum of greatest evidence over the study's starts and begins of another kind.

    Args:
        job: The run.
        group: Flights to be fitted, with their priors.
        prior: Priors of the noise parameters.
        begins: Further starting points; None stands for the prior means, which are always one.
        say: Progress callback: share done and words.

    Returns:
        The optimum. The comparison with the others is stored for `comparisons`.

    Raises:
        FloatingPointError: If every start failed.
    """
    flights = [data_of(job, f, group.priors) for f in group.flights]
    others = [begin for begin in begins if begin is not None]
    numbers = [*range(job.study.sampler.starts or 1), *range(-1, -1 - len(others), -1)]
    made = []
    for i, number in enumerate(numbers):

        def tell(share: float, words: str, i: int = i, number: int = number) -> None:
            say((i + share) / (len(numbers) + 1), f"start {number}, {i + 1} of {len(numbers)}: {words}")

        name = f"starts/{group.name}.{len(group.priors)}.{number}"
        kept = checkpoint.get_settled(job, name)
        if kept is not None and tuple(kept[0]) == group.priors:
            made.append(Start(number, kept[1]))
            continue
        if number < 0:
            start = Start(number, joint_fit(flights, group.priors, prior, progress=tell, begin=others[-1 - number]))
        else:
            seed = seed_of(job.study.seed, "starts of a fit", group.name)
            start = settle_from(flights, group.priors, prior, number, seed, progress=tell)
        if start.settled is not None:
            checkpoint.put_settled(job, name, group.priors, start.settled, {})
        made.append(start)
    best = best_of(made)
    assert best.settled is not None
    say(len(numbers) / (len(numbers) + 1), "comparing starts")
    rows = compare(flights, group.priors, best, [s for s in made if s is not best])
    verdict = judge(rows, best.settled.optimum.converged)
    said = {"kept": best.number, "verdict": verdict._asdict(), "others": [row._asdict() for row in rows]}
    checkpoint.put_said(job, f"starts/{group.name}", assemble.as_plain(said))
    return best.settled


def comparisons(job: Job, names: Sequence[str]) -> dict[str, Any]:
    """Comparison of the starts of every group, by its name; empty for fits from one start."""
    found = {name: checkpoint.get_said(job, f"starts/{name}") for name in names}
    return {name: said for name, said in found.items() if said is not None}


def note(said: dict[str, Any]) -> list[str]:
    """A line per group for the report, from `comparisons`."""
    return [
        f"Multistart check of the fit{f' of {name}' if len(said) > 1 else ''}: {one['verdict']['words']}."
        for name, one in said.items()
    ]


def check(said: dict[str, Any]) -> dict[str, Any]:
    """The check ``optima``, from `comparisons`."""
    verdicts = [one["verdict"] for one in said.values()]
    known = [v["away"] for v in verdicts if v["away"] is not None]
    words = " | ".join(f"{name}: {one['verdict']['words']}" for name, one in said.items())
    return {
        "passed": all(v["passed"] for v in verdicts),
        "value": max(known, default=0.0),
        "bound": NEAR,
        "detail": f"standard errors between optima that are not clearly worse, largest; {words}",
    }
