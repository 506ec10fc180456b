"""numpyro's No-U-Turn sampler (Hoffman & Gelman 2014), plain, and on a surrogate with exact delayed acceptance.

Delayed acceptance (Christen & Fox 2005): NUTS transitions on the surrogate, which leave it invariant and are
reversible, propose; the exact density accepts with probability ``min(1, [pi(y)/s(y)] / [pi(x)/s(x)])``. The chain's
stationary distribution is the exact posterior whatever the surrogate; a poor one shows as a low acceptance rate.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from numpy.typing import NDArray
from numpyro.infer import NUTS

from bayeschute.core.random import seed_of, stream
from bayeschute.posterior.sampling.protocol import Array, Counted, Draws, LogDensity, Progress

ScalarLogDensity = Callable[[jax.Array], jax.Array]
_STEPS_OF_COVARIANCE = 10  # of the warm-up per parameter, with which walks learn a covariance, not variances alone
_TRANSITIONS = 3  # NUTS transitions per proposal: enough to forget the start on a nearly Gaussian surrogate


def plain(
    log_density: ScalarLogDensity,
    parameters: int,
    chains: int,
    warmup: int,
    draws: int,
    seed: int,
    thinning: int = 1,
) -> Draws:
    """Draw with numpyro's NUTS from a differentiable log density.

    Args:
        log_density: Differentiable log density of a point (P,). A `jax.tree_util.Partial` of a function and its numbers
            is compiled once for all numbers.
        parameters: P.
        chains: Chains.
        warmup: Adaptation steps.
        draws: Draws per chain.
        seed: Seed.
        thinning: Steps per draw kept.

    Returns:
        The draws.
    """
    function = _portable(log_density)
    start = jnp.asarray(stream(seed, "start of NUTS").standard_normal((chains, parameters)))
    state = _begin(function, jax.random.split(jax.random.key(seed_of(seed, "NUTS")), chains), start, warmup)
    kept, steps = _walk(function, state, warmup, draws, thinning)
    made = {name: np.asarray(row) for name, row in kept.items()}
    xi, lp = made.pop("z"), -made.pop("potential_energy")
    stats = {"diverging": made["diverging"], "acceptance_rate": made["accept_prob"], "n_steps": made["num_steps"]}
    return Draws(xi, lp, stats, 0, int(steps))


def corrected(
    log_density: LogDensity,
    surrogate: ScalarLogDensity,
    parameters: int,
    chains: int,
    warmup: int,
    draws: int,
    seed: int,
    thinning: int = 1,
    streams: int = 16,
    progress: Progress | None = None,
) -> Draws:
    """Draw from an exact density with NUTS on its surrogate and delayed acceptance.

    `streams` independent walks run side by side in one batch of simulations; each chain of the result is made of
    ``streams / chains`` of them, laid end to end.

    Args:
        log_density: Exact log densities (B,) of points (P, B).
        surrogate: Differentiable log density of a point (P,), close to it. A `jax.tree_util.Partial` of a function and
            its numbers is compiled once for all numbers.
        parameters: P.
        chains: Chains of the result.
        warmup: Steps that adapt NUTS on the surrogate; a quarter of them also warms the exact walk up.
        draws: Draws per chain.
        seed: Seed.
        thinning: Steps per draw kept.
        streams: Walks in one batch; a multiple of `chains`.
        progress: Called with exact evaluations done and wanted.

    Returns:
        The draws, with acceptance rates of the exact step, and ``log_ratio``: exact less surrogate log density at what
        was proposed, minus infinity where a simulation failed (`why_not_trusted.pareto_k`).
    """
    per_chain = max(streams // chains, 1)
    streams, length = per_chain * chains, int(np.ceil(draws / per_chain))
    settle = max(warmup // 10, 10)
    function = _portable(surrogate)
    start = jnp.asarray(stream(seed, "start of delayed acceptance").standard_normal((streams, parameters)))
    state = _begin(
        function, jax.random.split(jax.random.key(seed_of(seed, "NUTS on the surrogate")), streams), start, warmup
    )
    state = _advance(function, state, warmup, warmup)

    counted, rng = Counted(log_density), stream(seed, "delayed acceptance")
    exact = counted(np.asarray(state.z).T)
    rows: dict[str, list[Array]] = {
        "xi": [],
        "log_density": [],
        "acceptance_rate": [],
        "diverging": [],
        "log_ratio": [],
    }
    last = settle + length * thinning
    for step in range(last):
        proposed = _advance(function, state, _TRANSITIONS, warmup)
        at = counted(np.asarray(proposed.z).T)
        with np.errstate(
            invalid="ignore"
        ):  # both infinite: a walk that starts where simulations fail stays until it can leave
            gain = at - exact + np.asarray(proposed.potential_energy - state.potential_energy)
        gain = np.where(np.isfinite(at), np.where(np.isfinite(exact), gain, np.inf), -np.inf)
        taken = np.log(rng.random(streams)) < gain
        exact = np.where(taken, at, exact)
        state = _take(taken, proposed, state)
        if step >= settle and (step - settle) % thinning == thinning - 1:
            rows["xi"].append(np.asarray(state.z))
            rows["log_density"].append(exact)
            rows["acceptance_rate"].append(np.exp(np.minimum(gain, 0.0)))
            rows["diverging"].append(np.asarray(proposed.diverging))
            rows["log_ratio"].append(at + np.asarray(proposed.potential_energy))
        if progress is not None:
            progress(step + 1, last)

    def chained(row: list[Array]) -> Array:
        stacked = np.stack(row, axis=1)  # (stream, step, ...)
        return stacked.reshape(chains, per_chain * length, *stacked.shape[2:])[:, :draws]

    made = {name: chained(row) for name, row in rows.items()}
    xi, lp = made.pop("xi"), made.pop("log_density")
    return Draws(xi, lp, made, counted.failed, counted.evaluations)


def _portable(log_density: ScalarLogDensity) -> Partial:
    """The density as an argument of compiled functions."""
    return log_density if isinstance(log_density, Partial) else Partial(log_density)


def _kernel(surrogate: ScalarLogDensity, parameters: int, warmup: int) -> NUTS:
    """NUTS in standard coordinates, which are nearly uncorrelated already.

    A covariance from few steps has axes that are far too short: of 79 parameters after 100 steps walks take five times
    as long as with variances alone, and mix no better.
    """
    enough = warmup >= _STEPS_OF_COVARIANCE * parameters
    return NUTS(potential_fn=lambda xi: -surrogate(xi), dense_mass=enough, target_accept_prob=0.85)


@partial(jax.jit, static_argnames="warmup")
def _begin(surrogate: Partial, keys: jax.Array, start: jax.Array, warmup: int) -> Any:
    """First states of NUTS at `start` (S, P)."""
    return _kernel(surrogate, start.shape[1], warmup).init(keys, warmup, start, (), {})


@partial(jax.jit, static_argnames="warmup")
def _advance(surrogate: Partial, state: Any, count: int, warmup: int) -> Any:
    """States after `count` transitions; the first `warmup` of all adapt."""
    step = _transition(surrogate, state, warmup)
    return jax.lax.fori_loop(0, count, lambda _, current: step(current), state)


@partial(jax.jit, static_argnames=("warmup", "draws", "thinning"))
def _walk(
    log_density: Partial, state: Any, warmup: int, draws: int, thinning: int
) -> tuple[dict[str, jax.Array], jax.Array]:
    """Kept fields of the states (S, draws, ...) after `warmup`, and all steps taken; one loop, so compiled once."""
    step = _transition(log_density, state, warmup)
    fields = ("z", "potential_energy", "diverging", "accept_prob", "num_steps")
    rows = {f: jnp.zeros((draws, *getattr(state, f).shape), getattr(state, f).dtype) for f in fields}

    def body(i: jax.Array, carry: tuple) -> tuple:
        current, kept, steps = carry
        current = step(current)
        row = jnp.where(i < warmup, draws, (i - warmup) // thinning)  # beyond the end: dropped
        kept = {f: kept[f].at[row].set(getattr(current, f), mode="drop") for f in fields}
        return current, kept, steps + jnp.sum(current.num_steps)

    _, rows, steps = jax.lax.fori_loop(0, warmup + draws * thinning, body, (state, rows, jnp.sum(0 * state.num_steps)))
    return {f: jnp.swapaxes(row, 0, 1) for f, row in rows.items()}, steps


def _transition(log_density: Partial, state: Any, warmup: int) -> Callable[[Any], Any]:
    """One transition of all states; numpyro keeps the schedule of adaptation in the kernel, hence `init`."""
    kernel = _kernel(log_density, state.z.shape[1], warmup)
    kernel.init(state.rng_key[0], warmup, state.z[0], (), {})
    return jax.vmap(lambda current: kernel.sample(current, (), {}))


def _take(taken: NDArray[np.bool_], proposed: Any, state: Any) -> Any:
    """The proposed place where taken, the old one elsewhere; keys and adaptation move on."""
    pick = jnp.asarray(taken)
    return proposed._replace(
        z=jnp.where(pick[:, None], proposed.z, state.z),
        z_grad=jnp.where(pick[:, None], proposed.z_grad, state.z_grad),
        potential_energy=jnp.where(pick, proposed.potential_energy, state.potential_energy),
    )
