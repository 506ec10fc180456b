"""The programs of a flight model, made when first asked for and shared by all flights of that kind."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from bayeschute.dynamics.kernel.differentiation import differentiation
from bayeschute.dynamics.kernel.machine import available, compiled
from bayeschute.dynamics.kernel.observation import observation
from bayeschute.dynamics.kernel.simulation import simulation
from bayeschute.dynamics.kernel.trace import Traced, UnknownOperationError, trace

LANES = 8
_lock = threading.RLock()
_known: dict[Any, Programs | str] = {}


class Compiled(NamedTuple):
    """A function in memory; what it needs [doubles]: scratch memory, and a table per Runge-Kutta step."""

    call: Callable[..., None]
    scratch: int
    table: int = 0


class Programs:
    """Programs of one kind of flight.

    Attributes:
        rate: Expressions of the rate of the state.
        outputs: Expressions of the outputs.
    """

    def __init__(self, rate: Traced, outputs: Traced) -> None:
        self.rate, self.outputs = rate, outputs
        self._made: dict[Any, Compiled] = {}

    def simulate(self, lanes: int) -> Compiled:
        """See `simulation`."""

        def make() -> Compiled:
            program = simulation(self.rate.graph.copy(), self.rate.result, self.rate.rows, lanes)
            return Compiled(compiled(program, tuned=lanes == 1), program.scratch)

        return self._once(lanes, make)

    def differentiate(self, groups: Sequence[str]) -> Compiled:
        """See `differentiation`."""

        def make() -> Compiled:
            traced = self.rate
            program, table = differentiation(traced.graph.copy(), traced.result, traced.rows, groups, LANES)
            return Compiled(compiled(program), program.scratch, table)

        return self._once(tuple(groups), make)

    def observe(self) -> Compiled:
        """See `observation`."""

        def make() -> Compiled:
            program = observation(self.outputs.graph.copy(), self.outputs.result, self.outputs.rows, LANES)
            return Compiled(compiled(program), program.scratch)

        return self._once("observe", make)

    def _once(self, key: Any, make: Callable[[], Compiled]) -> Compiled:
        with _lock:
            if key not in self._made:
                self._made[key] = make()
            return self._made[key]


def _rate(model: Any, theta: Any, x: Any, now: Any, then: Any, e0: Any, e1: Any, share: Any) -> jax.Array:
    return model.rate(x, model.numbers(theta), now, then, e0, e1, share)


def _observe(model: Any, theta: Any, x: Any, now: Any) -> jax.Array:
    return model.observe(x, model.numbers(theta), now)


def programs_of(model: Any, theta: Any, start: Any, error: Any) -> Programs | str:
    """The programs of a model, or why there are none.

    Args:
        model: A `FlightModel`.
        theta: Parameters (P, ...), of which only the number matters here, as of what follows.
        start: Initial deviations (D, ...).
        error: Latent disturbances (T, A, ...).
    """
    if not available():
        return "llvmlite is not installed"
    if jax.default_backend() != "cpu":
        return f"JAX computes on {jax.default_backend()}"
    if not hasattr(model, "rate"):
        return f"{type(model).__name__} has no method 'rate'"
    leaves, kind = jax.tree.flatten(model)
    sizes = np.shape(theta)[0], np.shape(start)[0], np.shape(error)[1]
    key = kind, tuple(np.shape(leaf) for leaf in leaves), sizes
    with _lock:
        if key not in _known:
            try:
                _known[key] = _traced(model, *(np.zeros(size) for size in sizes))
            except UnknownOperationError as operation:
                _known[key] = f"no scalar form of {operation}"
        return _known[key]


def _traced(model: Any, theta: np.ndarray, start: np.ndarray, error: np.ndarray) -> Programs:
    now = jax.tree.map(lambda a: np.asarray(a, float)[0], model.inputs())
    x = np.zeros(jax.eval_shape(lambda t, d: model.initial(model.numbers(t), d), theta, start).shape)
    rate = trace(
        _rate,
        (model, theta, x, now, now, error, error, 0.0),
        ("shared", "theta", "x", "now", "then", "error_now", "error_then", "share"),
    )
    return Programs(rate, trace(_observe, (model, theta, x, now), ("shared", "theta", "x", "now")))
