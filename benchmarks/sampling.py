"""Effective draws per second from a cold start: ours beside samplers that others wrote, on one posterior in one run.

The posterior is that of the default study's fit: 14 parameters, a 90 s record at 10 Hz, start and disturbances
integrated out, noise parameters held where they were found. A cold start is priors and data. That density does not
exist before its optimum and noise parameters are found, so every sampler is charged that, and every one gets what it
leaves: the Laplace approximation to begin with. To this come its own compilation, adaptation and draws. Every sampler
draws until its budget is spent, and the speed-ups compare that; a second row says what ours comes to with no more draws
than the study asks for, when most of its time is that of finding the density. Effective draws are ArviZ's (bulk, least
of all parameters, no more than there are). Where R-hat says that a peer has not converged, its number is too high and
the speed-up a lower bound; so it is where a peer has made too few draws to tell: each then counts as independent, and
none as one.

Gradient-free peers evaluate our machine code in batches, aeroid one by one. NUTS differentiates the same density in
JAX, as a user of those packages would; the machine code has derivatives too, but a callback to them is work of one's
own. Times are those of one processor (wall time with ``--wall``); each is given with and without compilation. Peers
that aren't installed are left out, with a word.

    python benchmarks/sampling.py [--budget 120] [--peers emcee_stretch pints ...] [--quick] [--wall] [--json]
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple

from command import parser_of, print_result

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy and JAX count the processors
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STUDY = Path(__file__).parents[1] / "models" / "studies" / "cdt-3-11.toml"
SAME = 1e-8  # the machine code's and JAX' log densities, largest difference
SHARES = (0.1, 0.25, 0.5)  # of a peer's draws that are left out in turn; the best counts
ENOUGH = 4  # draws per chain from which effective draws are estimated
FLOOR = 500.0  # added to what the density is beside squares, so that its square root can be taken


class Row(NamedTuple):
    """What a sampler made.

    Attributes:
        ess: Least bulk effective draws of a parameter.
        draws: Draws behind them.
        rhat: Largest R-hat; not a number where there are too few draws.
        seconds: From the cold start, compilation in.
        without: The same, compilation out.
        sampling: Its own share, compilation out.
        off: Largest difference of a mean from ours, in standard deviations.
    """

    ess: float
    draws: int
    rhat: float
    seconds: float
    without: float
    sampling: float
    off: float

    @property
    def remark(self) -> str:
        """What a reader of the number must know."""
        from bayeschute.posterior.sampling.sampler_checks import MOST_RHAT

        if not np.isfinite(self.rhat):
            return "too few draws to tell: each counts as independent"
        return "" if self.rhat < MOST_RHAT else "not converged: effective draws too high"


def effective(xi: Array) -> tuple[float, float]:
    """Least bulk effective draws, and largest R-hat, of (chain, draw, P); the number of draws where those are few."""
    import arviz_stats
    import xarray as xr

    if xi.shape[1] < ENOUGH:
        return float(max(xi.shape[0] * xi.shape[1], 1)), np.nan
    draws = xr.DataArray(xi, dims=("chain", "draw", "parameter"))
    least = float(np.min(np.asarray(arviz_stats.ess(draws, method="bulk"))))
    return min(least, float(draws[..., 0].size)), float(np.max(np.asarray(arviz_stats.rhat(draws))))


def kindest(xi: Array) -> tuple[float, float, Array]:
    """`effective` and the draws, after the opening whose loss costs least."""
    kept = [xi[:, int(share * xi.shape[1]) :] for share in SHARES] if xi.shape[1] >= 2 * ENOUGH else [xi]
    return max(((*effective(x), x) for x in kept), key=lambda made: made[0])


def off(xi: Array, reference: Array) -> float:
    """Largest difference of a mean from the reference's, in the reference's standard deviations."""
    if not xi.size:
        return float(np.nan)
    apart = xi.mean(axis=(0, 1)) - reference.mean(axis=(0, 1))
    return float(np.max(np.abs(apart) / reference.std(axis=(0, 1))))


def target_of(marginal: Any) -> Any:
    """The density as peers take it."""
    import jax
    import jax.numpy as jnp
    from sampling_peers import Target

    from bayeschute.likelihood.joint import compared, jax_states
    from bayeschute.likelihood.kalman import innovations
    from bayeschute.posterior.marginal import latent_path_at, log_density, projected_residuals, shifted

    def one(numbers: Any, xi: jax.Array) -> jax.Array:
        """The marginal log density by JAX alone: `marginal.log_density` goes through machine code."""
        column = xi[:, None]
        theta, shift = shifted(numbers, column)
        total = -numbers.correction.at(column)[0]
        for flight, along in zip(numbers.flights, numbers.along, strict=True):
            residual = compared(flight, theta, jax_states(flight, theta, latent_path_at(along, shift)))
            seen = residual + (along.offset - along.mean_correction)[..., None] + along.offset_slope @ shift
            total -= 0.5 * jnp.sum(innovations(along.gains, seen) ** 2)
        away = theta[:, 0] - numbers.prior_centre
        return total - 0.5 * jnp.sum(jax.scipy.linalg.solve_triangular(numbers.prior_factor, away, lower=True) ** 2)

    def residuals(xi: Array) -> Array:
        correction = np.sqrt(2.0 * (FLOOR + np.asarray(marginal.correction.at(xi))))
        return np.concatenate([np.asarray(projected_residuals(marginal, xi))[:, 0], correction])

    scale, centre = np.asarray(marginal.scale), np.asarray(marginal.centre)
    to_prior = np.linalg.solve(np.asarray(marginal.prior_factor), scale)
    offset = np.linalg.solve(np.asarray(marginal.prior_factor), centre - np.asarray(marginal.prior_centre))
    size = int(centre.size)
    return Target(size, lambda xi: np.asarray(log_density(marginal, xi)), residuals, one, marginal, (to_prior, offset))


def apart(target: Any, count: int = 4) -> float:
    """Largest difference of the two ways to the log density, at draws of the Laplace approximation."""
    import jax

    xi = np.random.default_rng(0).standard_normal((target.parameters, count))
    ours = jax.jit(jax.vmap(target.one, in_axes=(None, 1)))(target.numbers, xi)
    return float(np.max(np.abs(np.asarray(ours) - target.batched(xi))))


def begin(folder: Path, quick: bool, seed: int) -> tuple[Any, list[Any], Any, Any]:
    """Priors and data of the study's fit: priors, flights, priors of the noise parameters, settings of the sampler."""
    from bayeschute.study.assembly import assemble
    from bayeschute.study.assembly.fits import data_of, groups
    from bayeschute.study.job import Job
    from bayeschute.study.load import load_study
    from bayeschute.study.run.stages import run_study

    run_study(STUDY, folder, until="priors", quick=quick, seed=seed)
    study = load_study(STUDY)
    job = Job(assemble.smaller(study) if quick else study, folder, quick, "", lambda *_: None)
    group = groups(job)[0]
    flights = [data_of(job, flight, group.priors) for flight in group.flights]
    return group.priors, flights, assemble.noise_prior(study), job.study.sampler


def twice(now: Callable[[], float], work: Callable[[], Any]) -> tuple[Any, float, float]:
    """What a work makes, and its time [s] from cold, and again when all of it is compiled."""
    start = now()
    made = work()
    middle = now()
    work()
    return made, middle - start, now() - middle


def ours(given: argparse.Namespace, now: Callable[[], float], folder: Path) -> tuple[Any, Array, list[Row], tuple]:
    """Find and draw as a run does.

    Returns:
        The posterior; draws for the budget; rows for the budget and for the study's number of draws; times of finding
        with and without compilation.
    """
    from bayeschute.posterior.fit.laplace_fit import find
    from bayeschute.posterior.sampler import sample

    priors, flights, prior, table = begin(folder, given.quick, given.seed)
    rounds = 1 if given.quick else 2
    found, cold, warm = twice(now, lambda: find(flights, priors, prior, rounds))
    print(f"found: {cold:.1f} s, {warm:.1f} s of them without compilation; {len(priors)} parameters", flush=True)
    size = table.chains, table.warmup, table.draws, given.seed
    draws, first, again = twice(now, lambda: sample(found.marginal, "nuts", *size))
    compiled, rows = first - again, []
    most, began = int(table.draws * max(given.budget / again, 1.0)), now()
    many = sample(found.marginal, "nuts", table.chains, table.warmup, most, given.seed)
    for made, spent in ((many, now() - began), (draws, again)):
        for note in made.notes:
            print(f"  {note}")
        ess, rhat = effective(made.xi)
        apart = off(made.xi, many.xi)
        rows.append(
            Row(ess, made.xi[..., 0].size, rhat, cold + compiled + spent, warm + spent, spent, apart)
        )  # fmt: skip
    return found.marginal, many.xi, rows, (cold, warm)


def peer_row(peer: Any, target: Any, given: argparse.Namespace, now: Any, found: tuple, reference: Array) -> Row:
    """Let a peer draw, and count."""
    import jax
    from sampling_peers import Clock

    jax.clear_caches()  # as in a process of its own
    clock = Clock(now, given.budget)
    xi = peer(target, clock, given.seed)
    total, compiled = clock.total, clock.compiled
    ess, rhat, kept = kindest(xi)
    sampling = total - compiled
    return Row(ess, kept[..., 0].size, rhat, found[0] + total, found[1] + sampling, sampling, off(kept, reference))


def tell(name: str, row: Row) -> None:
    """Print a row."""
    print(
        f"{name:26} {row.ess:8.0f} of {row.draws:7d} draws, R-hat {row.rhat:6.3f}, {row.seconds:6.1f} s "
        f"({row.without:6.1f} without compilation): {row.ess / row.seconds:8.3f} per s; mean off by {row.off:.2f} sd "
        f" {row.remark}",
        flush=True,
    )


def speedups(mine: Row, rows: dict[str, tuple[str, Row]], time: str) -> dict[str, float]:
    """Our effective draws per second over a peer's, by its name; of several of one name the fastest counts."""
    made: dict[str, float] = {}
    for key, row in rows.values():
        ratio = mine.ess / getattr(mine, time) * getattr(row, time) / row.ess
        made[f"speedup_vs_{key}"] = min(ratio, made.get(f"speedup_vs_{key}", np.inf))
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--budget", type=float, default=120.0, help="of every peer, compilation not counted [s]")
    parser.add_argument("--peers", nargs="*", help="all where not given")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="a third of the record, few draws; not for use")
    parser.add_argument("--wall", action="store_true", help="wall time, all processors")
    given = parser.parse_args(arguments)
    now = perf_counter if given.wall else process_time
    if not given.wall and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as folder:
        os.environ["BAYESCHUTE_CACHE"] = str(Path(folder) / "cache")  # nothing compiled earlier
        measure(given, now, Path(folder))


def measure(given: argparse.Namespace, now: Callable[[], float], folder: Path) -> None:
    """Everything between the arguments and the tables."""
    import jax
    from sampling_peers import PEERS

    known = dict.fromkeys(key for key, _ in PEERS.values())
    if unknown := {*(given.peers or ())} - {*known}:
        raise SystemExit(f"no peer {', '.join(sorted(unknown))}: {', '.join(known)}")
    wanted = {name: peer for name, peer in PEERS.items() if given.peers is None or peer[0] in given.peers}
    jax.config.update("jax_enable_compilation_cache", False)
    marginal, reference, (mine, asked), found = ours(given, now, folder / "run")
    tell("bayeschute", mine)
    tell("  as a study asks", asked)
    target, rows = target_of(marginal), dict[str, tuple[str, Row]]()
    difference = None
    if any("nuts" in key or key == "blackjax" for key, _ in wanted.values()):
        difference = apart(target)
        print(f"machine code and JAX give log densities within {difference:.0e} of each other", flush=True)
        if not difference < SAME:
            raise SystemExit("they are not the same density")
    absent = []
    for name, (key, peer) in wanted.items():
        try:
            rows[name] = key, peer_row(peer, target, given, now, found, reference)
        except ModuleNotFoundError as error:
            absent.append(name)
            print(f"{name:26} {error.name} is not installed (extra 'bench'): not compared")
            continue
        tell(name, rows[name][1])
    ratios, fewer = speedups(mine, rows, "seconds"), speedups(asked, rows, "seconds")
    others = {time: speedups(mine, rows, time) for time in ("without", "sampling")}
    for name, value in ratios.items():
        print(
            f"{name:36} {value:10.1f}; without compilation {others['without'][name]:.1f}, "
            f"sampling alone {others['sampling'][name]:.1f}, with a study's draws {fewer[name]:.1f}"
        )
    context = {
        "budget_s": given.budget, "clock": "wall" if given.wall else "processor", "quick": given.quick,
        "found_s": found[0], "found_without_compilation_s": found[1], "densities_differ_by": difference,
        "speedups_without_compilation": others["without"], "speedups_sampling_alone": others["sampling"],
        "speedups_with_the_draws_of_a_study": fewer,
        "bayeschute": plain(mine), "bayeschute_as_a_study_asks": plain(asked),
        "peers": {name: plain(row) for name, (_, row) in rows.items()},
        "absent": absent,
    }  # fmt: skip
    print_result(given, ratios, context)


def plain(row: Row) -> dict[str, Any]:
    """A row as JSON holds it."""
    made = {key: None if not np.isfinite(value) else value for key, value in row._asdict().items()}
    return made | {"remark": row.remark}


if __name__ == "__main__":
    main()
