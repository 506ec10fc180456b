"""Where the coefficients of `bayeschute.compiler.runge_kutta.EXTENDED` come from.

Among the methods of S stages and fourth order in which every stage begins on the way that the rate at the one before
points, the one is sought whose factor R(z) is nearest to exp(z) on the negative real axis down to a given place, with
the whole half disc of radius 1.5 stable: sequential quadratic programming from random starts, several optima being
equally good. Printed are the best of them, whose error constants and weights tell which to take, and beside them the
methods that are in use.

    python benchmarks/extended_steps.py --stages 6 --reach 8.4
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED, RungeKutta
from bayeschute.core import numerics as numerics  # 64 bits

Array = NDArray[np.float64]
_DISC = 1.5
_SMALL = 1e-2, 2.0  # of the squares of weights, and of the error constants, in the objective


def _split(v: jax.Array, stages: int) -> tuple[jax.Array, jax.Array]:
    return jnp.concatenate([jnp.zeros(1), v[: stages - 1]]), v[stages - 1 : 2 * stages - 1]


def _back(c: jax.Array, by: int) -> jax.Array:
    return jnp.concatenate([jnp.zeros(by), c[: len(c) - by]])


def order_conditions(c: jax.Array, b: jax.Array) -> jax.Array:
    """What sums over the eight trees up to fourth order lack (Hairer, Norsett and Wanner 1993, table II.2.1)."""
    one, two = _back(c, 1), _back(c, 2)
    sums = [b.sum(), b @ c, b @ c**2, b @ (c * one), b @ c**3, b @ (c**2 * one), b @ (c * one**2), b @ (c * one * two)]
    return jnp.stack(sums) - jnp.array([1.0, 1 / 2, 1 / 3, 1 / 6, 1 / 4, 1 / 8, 1 / 12, 1 / 24])


def error_constants(c: jax.Array, b: jax.Array) -> jax.Array:
    """What sums over the nine trees of fifth order lack, over their symmetries."""
    one, two, three = (_back(c, k) for k in (1, 2, 3))
    sums = [
        b @ c**4, b @ (c**3 * one), b @ (c**2 * one**2), b @ (c**2 * one**2), b @ (c**2 * one * two), b @ (c * one**3),
        b @ (c * one**2 * two), b @ (c * one * two**2), b @ (c * one * two * three),
    ]  # fmt: skip
    wanted = jnp.array([1 / 5, 1 / 10, 1 / 20, 1 / 15, 1 / 30, 1 / 20, 1 / 40, 1 / 60, 1 / 120])
    return (jnp.stack(sums) - wanted) / jnp.array([24.0, 2.0, 2.0, 2.0, 1.0, 6.0, 1.0, 2.0, 1.0])


def factor(c: jax.Array, b: jax.Array, z: Array) -> jax.Array:
    """R(z)."""
    made, product = [jnp.ones(())], b
    for k in range(len(b)):
        made.append(product.sum())
        product = product * _back(c, k)
    return jnp.polyval(jnp.stack(made[::-1]), z)


def best(stages: int, reach: float, starts: int, seed: int) -> list[tuple[float, RungeKutta]]:
    """Largest distance of R(z) from exp(z), and method, of the optima that were found, the best first."""
    real = -0.5 * reach * (1.0 - np.cos(np.linspace(0.0, np.pi, 24 * stages)))
    disc = _DISC * np.exp(1j * np.linspace(np.pi / 2.0, np.pi, 16))

    def rest(v: jax.Array) -> jax.Array:
        (c, b), distance = _split(v, stages), v[-1]
        off = factor(c, b, real) - np.exp(real)
        stable = 1.0 - jnp.abs(factor(c, b, disc)) ** 2
        return jnp.concatenate([distance - off, distance + off, stable, c[1:], 1.0 - c[1:]])

    def objective(v: jax.Array) -> jax.Array:
        c, b = _split(v, stages)
        return v[-1] + _SMALL[0] * jnp.sum(b**2) + _SMALL[1] * jnp.sum(error_constants(c, b) ** 2)

    def plain(function: Callable[[jax.Array], jax.Array]) -> Callable[[Array], Array]:
        made = jax.jit(function)
        return lambda v: np.asarray(made(v))

    equal, above = (lambda v: order_conditions(*_split(v, stages))), rest
    constraints = [
        {"type": kind, "fun": plain(function), "jac": plain(jax.jacfwd(function))}
        for kind, function in (("eq", equal), ("ineq", above))
    ]
    rng, found = np.random.default_rng(seed), list[tuple[float, RungeKutta]]()
    for _ in range(starts):
        weights = rng.uniform(-0.2, 1.0, stages)
        first = np.concatenate([np.sort(rng.uniform(0.05, 1.0, stages - 1)), weights / weights.sum(), [1.0]])
        made = minimize(
            plain(objective), first, jac=plain(jax.grad(objective)), method="SLSQP", constraints=constraints,
            options={"maxiter": 400, "ftol": 1e-9},
        )  # fmt: skip
        c, b = (np.asarray(part) for part in _split(made.x, stages))
        if np.abs(np.asarray(order_conditions(c, b))).max() < 1e-9 and np.asarray(rest(made.x)).min() > -1e-6:
            found.append((float(made.x[-1]), RungeKutta(tuple(c[1:].tolist()), tuple(b.tolist()))))
    return sorted(found, key=lambda one: one[0])


def told(name: str, method: RungeKutta) -> str:
    """A method in words."""
    c, b = jnp.array([0.0, *method.ways]), jnp.array(method.weights)
    z = -np.linspace(0.0, 40.0, 400001)
    past = np.flatnonzero(np.abs(np.polyval(method.growth[::-1], z)) > 1.0 + 1e-9)
    ways, weights = (", ".join(f"{value:.4f}" for value in part) for part in method)
    size = float(jnp.linalg.norm(error_constants(c, b)))
    return f"{name}: stable to {z[past[0]]:.2f}, error constants {size:.4f}; ways {ways}; weights {weights}"


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stages", type=int, default=6)
    parser.add_argument("--reach", type=float, default=8.4)
    parser.add_argument("--starts", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    print(told("classical", CLASSICAL))
    print(told("extended", EXTENDED))
    for distance, method in best(given.stages, given.reach, given.starts, given.seed)[:8]:
        print(told(f"{distance:.3f} from exp(z)", method))


if __name__ == "__main__":
    main()
