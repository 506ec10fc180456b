"""Samplers that others wrote, each on the same density until its time is up.

Every one begins at draws of the Laplace approximation, which finding the posterior has left; so the gradient-free ones
need no way in, only their own adaptation. Those that take batches get them. NUTS differentiates the JAX path backward,
all chains side by side: a user of those packages has no machine code for a gradient.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import emcee
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from numpyro.infer import NUTS

Array = NDArray[np.float64]
WALKERS, PINTS_CHAINS, CHAINS = 64, 16, 8
DEEPEST = 10  # deepest tree of NUTS, numpyro's and blackjax's own
ACCEPTANCE = 0.8  # wanted of NUTS, numpyro's and blackjax's own
LEAPFROGS = 8  # per transition, guessed to share the time between adaptation and draws


@dataclass
class Clock:
    """Time [s] of one peer by a clock of choice; compilation is counted on its own and not against the budget."""

    now: Callable[[], float]
    budget: float
    compiled: float = 0.0
    began: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin."""
        self.began = self.now()

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Count what is inside as compilation."""
        start = self.now()
        yield
        self.compiled += self.now() - start

    @property
    def total(self) -> float:
        """Time since the beginning, compilation included."""
        return self.now() - self.began

    def left(self) -> float:
        """Time left of the budget."""
        return self.budget - (self.total - self.compiled)


class Target(NamedTuple):
    """The posterior in standard coordinates xi (P,), where its Laplace approximation is standard normal.

    Attributes:
        parameters: P.
        batched: Log densities (B,) of points (P, B).
        residuals: Vectors (N, B) whose ``-1/2 |.|^2`` is the log density up to a constant.
        one: Differentiable log density of a point (P,), the numbers that it depends on first.
        numbers: Those.
        to_prior: Matrix and offset from xi to coordinates in prior standard deviations.
    """

    parameters: int
    batched: Callable[[Array], Array]
    residuals: Callable[[Array], Array]
    one: Callable[[Any, jax.Array], jax.Array]
    numbers: Any
    to_prior: tuple[Array, Array]

    def finite(self, xi: Array) -> Array:
        """As `batched`, minus infinity where a simulation fails."""
        value = np.asarray(self.batched(np.asarray(xi)))
        return np.where(np.isfinite(value), value, -np.inf)


def by_emcee(target: Target, clock: Clock, seed: int, moves: list[tuple[Any, float]]) -> Array:
    """One ensemble of emcee; its walkers stand for chains."""
    start = np.random.default_rng([seed, 30]).standard_normal((WALKERS, target.parameters))
    with clock.compiling():
        target.finite(start.T), target.finite(start[: WALKERS // 2].T)
    sampler = emcee.EnsembleSampler(
        WALKERS, target.parameters, lambda x: target.finite(x.T), moves=moves, vectorize=True
    )
    sampler._random = np.random.RandomState(seed)  # emcee takes a state only together with a position
    state = emcee.State(start)
    while clock.left() > 0.0:
        state = sampler.run_mcmc(state, 5, skip_initial_state_check=True)
    return np.swapaxes(sampler.get_chain(), 0, 1)


def stretch(target: Target, clock: Clock, seed: int) -> Array:
    """Ensemble of emcee with the stretch move, its default."""
    return by_emcee(target, clock, seed, [(emcee.moves.StretchMove(), 1.0)])


def differential(target: Target, clock: Clock, seed: int) -> Array:
    """Ensemble of emcee with differential evolution moves; its snooker moves don't keep the law."""
    return by_emcee(target, clock, seed, [(emcee.moves.DEMove(), 1.0)])


def _asked(target: Target, clock: Clock, ask: Callable[[], Array], tell: Callable[[Array], Any]) -> Array:
    """Ask-and-tell until time is up: places after every step (chain, draw, P)."""
    rows = []
    with clock.compiling():
        target.finite(np.zeros((target.parameters, PINTS_CHAINS)))
    while clock.left() > 0.0:
        rows.append(tell(target.finite(ask().T)))
    return np.stack(rows, axis=1)


def haario_bardenet(target: Target, clock: Clock, seed: int) -> Array:
    """PINTS' adaptive covariance MCMC, its default method; chains in one batch, 200 steps before adaptation."""
    import pints

    np.random.seed(seed)  # PINTS knows no other
    start = np.random.default_rng([seed, 31]).standard_normal((PINTS_CHAINS, target.parameters))
    chains = [pints.HaarioBardenetACMC(x, np.full(target.parameters, 0.3)) for x in start]
    steps = 0

    def tell(values: Array) -> Array:
        nonlocal steps
        steps += 1
        if steps == 200:
            for chain in chains:
                chain.set_initial_phase(False)
        return np.array([np.array(c.tell(v)[0]) for c, v in zip(chains, values, strict=True)])

    return _asked(target, clock, lambda: np.array([c.ask() for c in chains]), tell)


def dream(target: Target, clock: Clock, seed: int) -> Array:
    """PINTS' DREAM; chains in one batch, 200 steps before its crossover is fixed."""
    import pints

    np.random.seed(seed)
    start = np.random.default_rng([seed, 32]).standard_normal((PINTS_CHAINS, target.parameters))
    whole = pints.DreamMCMC(PINTS_CHAINS, list(start), np.ones(target.parameters))
    steps = 0

    def tell(values: Array) -> Array:
        nonlocal steps
        steps += 1
        if steps == 200:
            whole.set_initial_phase(False)
        return np.array(whole.tell(values)[0])

    return _asked(target, clock, lambda: np.array(whole.ask()), tell)


def aeroid(target: Target, clock: Clock, seed: int) -> Array:
    """Stretch ensemble of aeroid, which simulates one walker at a time.

    It takes no density, only a simulator with independent Gaussian errors: the residual vector is handed over as the
    simulator's output, its data zero and its noise one. Its walkers begin within 1 % of their centre: 100 stands for 0.
    """
    import aeroid as package

    names = [f"x{i}" for i in range(target.parameters)]
    with clock.compiling():
        size = target.residuals(np.zeros((target.parameters, 1))).shape[0]
    calls: list[float] = []

    def simulate(time: Array, controls: Any, x0: Any, parameters: Mapping[str, float], **options: Any) -> Any:
        xi = np.array([[parameters[name] - 100.0] for name in names])
        begin = clock.now()
        out = target.residuals(xi)
        calls.append(clock.now() - begin)
        return SimpleNamespace(outputs=np.where(np.isfinite(out), out, 1e8)[:, None])

    plane = SimpleNamespace(
        states=(), controls=(), outputs=("residual",), parameters=dict.fromkeys(names, 100.0), name="posterior",
        simulate=simulate, simulate_data=None,
    )  # fmt: skip
    data = package.FlightData(np.arange(float(size)), {"residual": np.zeros(size)})
    for _ in range(5):
        simulate(np.zeros(0), None, None, plane.parameters)
    walkers = 2 * target.parameters + 4
    steps = max(int(clock.left() / (float(np.median(calls)) * walkers)) - 1, 4)
    made = package.infer(
        plane, data, {name: package.Uniform(0.0, 200.0) for name in names}, noise={"residual": 1.0},
        initial=dict.fromkeys(names, 100.0), n_walkers=walkers, n_steps=steps, burn_in=0, seed=seed,
    )  # fmt: skip
    return np.swapaxes(made.samples.reshape(steps, walkers, -1), 0, 1) - 100.0


def _adapting(clock: Clock, step: Callable[[], Any]) -> int:
    """Transitions that adapt, about a third of what the budget holds."""
    start = clock.now()
    jax.block_until_ready(step())
    one = LEAPFROGS * (clock.now() - start)
    return int(np.clip(clock.left() / 3.0 / one, 3, 300))


def by_numpyro(target: Target, clock: Clock, seed: int, plain: bool) -> Array:
    """NUTS of numpyro: plain, or whitened by the Laplace approximation with nothing but its step left to adapt."""
    matrix, offset = target.to_prior if plain else (np.eye(target.parameters), np.zeros(target.parameters))
    back = np.linalg.inv(matrix)
    start = np.random.default_rng([seed, 33]).standard_normal((CHAINS, target.parameters)) @ matrix.T + offset

    def density(numbers: Any, x: jax.Array) -> jax.Array:
        return target.one(numbers, jnp.asarray(back) @ (x - jnp.asarray(offset)))

    def kernel(numbers: Any) -> NUTS:
        return NUTS(
            potential_fn=lambda x: -density(numbers, x), dense_mass=plain, adapt_mass_matrix=plain,
            target_accept_prob=ACCEPTANCE, max_tree_depth=DEEPEST,
        )  # fmt: skip

    keys = jax.random.split(jax.random.key(seed), CHAINS)
    init = jax.jit(lambda numbers, keys, x, n: kernel(numbers).init(keys, n, x, (), {}), static_argnums=3)
    with clock.compiling():
        begin = init.lower(target.numbers, keys, jnp.asarray(start), 300).compile()
    warmup = _adapting(clock, lambda: begin(target.numbers, keys, jnp.asarray(start)))

    def transition(numbers: Any, state: Any) -> Any:
        made = kernel(numbers)
        made.init(state.rng_key[0], warmup, state.z[0], (), {})  # numpyro keeps the schedule in the kernel
        return jax.vmap(lambda s: made.sample(s, (), {}))(state)

    state = begin(target.numbers, keys, jnp.asarray(start))
    with clock.compiling():
        advance = jax.jit(transition).lower(target.numbers, state).compile()
    rows, done = [], 0
    while clock.left() > 0.0:
        state = jax.block_until_ready(advance(target.numbers, state))
        done += 1
        if done > warmup:
            rows.append((np.asarray(state.z) - offset) @ back.T)
    return np.stack(rows, axis=1) if rows else np.zeros((CHAINS, 0, target.parameters))


def numpyro_plain(target: Target, clock: Clock, seed: int) -> Array:
    """NUTS of numpyro in prior standard deviations, dense mass matrix adapted."""
    return by_numpyro(target, clock, seed, True)


def numpyro_whitened(target: Target, clock: Clock, seed: int) -> Array:
    """NUTS of numpyro, Laplace-whitened."""
    return by_numpyro(target, clock, seed, False)


def by_blackjax(target: Target, clock: Clock, seed: int) -> Array:
    """NUTS of blackjax, Laplace-whitened, its step adapted by dual averaging over all chains."""
    import blackjax
    from blackjax.adaptation.step_size import dual_averaging_adaptation

    start = np.random.default_rng([seed, 34]).standard_normal((CHAINS, target.parameters))

    def moved(numbers: Any, keys: jax.Array, state: Any, length: jax.Array) -> tuple[Any, jax.Array]:
        density = partial(target.one, numbers)
        step = blackjax.nuts(density, length, jnp.ones(target.parameters), max_num_doublings=DEEPEST).step
        state, info = jax.vmap(step)(keys, state)
        return state, jnp.mean(info.acceptance_rate)

    def first(numbers: Any, x: jax.Array) -> Any:
        return jax.vmap(lambda z: blackjax.nuts.init(z, partial(target.one, numbers)))(x)

    key = jax.random.key(seed)
    with clock.compiling():
        begin = jax.jit(first).lower(target.numbers, jnp.asarray(start)).compile()
    warmup = _adapting(clock, lambda: begin(target.numbers, jnp.asarray(start)))
    state = begin(target.numbers, jnp.asarray(start))
    keys = jax.random.split(key, CHAINS)
    with clock.compiling():
        advance = jax.jit(moved).lower(target.numbers, keys, state, jnp.asarray(0.5)).compile()
    opening, update, final = dual_averaging_adaptation(ACCEPTANCE)
    adapted, rows, done = opening(0.5), [], 0
    while clock.left() > 0.0:
        length = jnp.exp(adapted.log_step_size) if done < warmup else final(adapted)
        key, now = jax.random.split(key)
        state, rate = advance(target.numbers, jax.random.split(now, CHAINS), state, jnp.asarray(length, float))
        done += 1
        if done <= warmup:
            adapted = update(adapted, rate)
        else:
            rows.append(np.asarray(state.position))
    return np.stack(rows, axis=1) if rows else np.zeros((CHAINS, 0, target.parameters))


Peer = Callable[[Target, Clock, int], Array]
PEERS: dict[str, tuple[str, Peer]] = {
    "emcee, stretch": ("emcee_stretch", stretch),
    "emcee, DE": ("emcee_de", differential),
    "PINTS, Haario-Bardenet": ("pints", haario_bardenet),
    "PINTS, DREAM": ("pints", dream),
    "aeroid, stretch": ("aeroid", aeroid),
    "numpyro NUTS, whitened": ("numpyro_nuts_whitened", numpyro_whitened),
    "blackjax NUTS, whitened": ("blackjax", by_blackjax),
    "numpyro NUTS, plain": ("numpyro_nuts_plain", numpyro_plain),
}
