"""Cache of the compiled programs of flight models, shared by all flights of the same kind."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np

from bayeschute.compiler.differentiation import differentiation
from bayeschute.compiler.evaluation import LANES, BySample, evaluation
from bayeschute.compiler.graph import SHARED
from bayeschute.compiler.machine import available, compiled
from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.compiler.simulation import simulation
from bayeschute.compiler.trace import Traced, UnknownOperationError, trace

_lock = threading.RLock()
_known: dict[Any, Programs | str] = {}
_observed: dict[Hashable, BySample | UnknownOperationError] = {}


class Compiled(NamedTuple):
    """A function in memory; what it needs [doubles]: scratch memory, and a table per stage."""

    call: Callable[..., None]
    scratch: int
    table: int = 0


class Programs:
    """Programs of one kind of flight.

    Attributes:
        rate: Expressions of the rate of the state.
        outputs: Expressions of the outputs.
        first: Expressions of the first state, of a model cut to its `opening`.
    """

    def __init__(self, rate: Traced, outputs: Traced, first: Traced) -> None:
        self.rate, self.outputs, self.first = rate, outputs, first
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
        """Outputs and their derivatives by state and parameters, samples side by side; see `evaluation`."""
        return self._once("observe", lambda: _evaluation(self.outputs, ("x", "now"), ("x", "theta"), LANES))

    def begin(self, lanes: int) -> Compiled:
        """First states, flights side by side; see `evaluation`."""
        return self._once(("begin", lanes), lambda: _evaluation(self.first, ("theta", "start"), (), lanes))

    def begin_slopes(self) -> Compiled:
        """The first state and its derivatives by parameters and deviations; see `evaluation`."""
        return self._once("begin_slopes", lambda: _evaluation(self.first, (), ("theta", "start"), 1))

    def _once(self, key: Any, make: Callable[[], Compiled]) -> Compiled:
        with _lock:
            if key not in self._made:
                self._made[key] = make()
            return self._made[key]


def _evaluation(traced: Traced, varied: Sequence[str], by: Sequence[str], lanes: int) -> Compiled:
    program = evaluation(traced.graph.copy(), traced.result, traced.rows, varied, by, lanes)
    return Compiled(compiled(program), program.scratch)


def _rate(model: Any, theta: Any, x: Any, now: Any, then: Any, e0: Any, e1: Any, share: Any) -> jax.Array:
    return model.rate(x, model.numbers(theta), now, then, e0, e1, share)


def _observe(model: Any, theta: Any, x: Any, now: Any) -> jax.Array:
    return model.observe(x, model.numbers(theta), now)


def initial(model: Any, theta: Any, start: Any) -> jax.Array:
    """The first state (X, ...) of a model with parameters (P, ...) and initial deviations (D, ...)."""
    return model.initial(model.numbers(theta), start)


def opening(model: Any) -> Any:
    """A model whose inputs end with the first sample, in a single step: its functions of a sample know of no more."""
    inputs = {id(leaf) for leaf in jax.tree.leaves(model.inputs())}
    begun = jax.tree.map(lambda leaf: leaf[:1] if id(leaf) in inputs else leaf, model)
    return replace(begun, stepping=Stepping(1))


def kind_of(begun: Any) -> Hashable:
    """What models have in common whose functions have the same trace: type, structure, shapes of the numbers.

    Args:
        begun: The `opening` of a model: the functions are those of a sample, however many there are.
    """
    leaves, structure = jax.tree.flatten(begun)
    return type(begun), structure, tuple(np.shape(leaf) for leaf in leaves)


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
    sizes = np.shape(theta)[0], np.shape(start)[0], np.shape(error)[1]
    begun = opening(model)
    key = kind_of(begun), sizes
    with _lock:
        if key not in _known:
            try:
                _known[key] = _traced(begun, *(np.zeros(size) for size in sizes))
            except UnknownOperationError as operation:
                _known[key] = f"no scalar form of {operation}"
        return _known[key]


def _traced(begun: Any, theta: np.ndarray, start: np.ndarray, error: np.ndarray) -> Programs:
    first = trace(initial, (begun, theta, start), (SHARED, "theta", "start"))
    x, now = np.zeros(len(first.result)), _first_inputs(begun)
    rate = _at_a_sample(
        _rate,
        (begun, theta, x, now, now, error, error, 0.0),
        (SHARED, "theta", "x", "now", "then", "error_now", "error_then", "share"),
    )
    return Programs(rate, observed(begun, len(theta), len(x)).function, first)


def _first_inputs(begun: Any) -> Any:
    return jax.tree.map(lambda a: np.asarray(a, float)[0], begun.inputs())


def _at_a_sample(function: Callable, examples: Sequence[Any], groups: Sequence[str]) -> Traced:
    """The trace of a function of the opening of a model; it must take a sample's inputs as arguments alone."""
    made = trace(function, examples, groups)
    inputs = {id(leaf) for leaf in jax.tree.leaves(examples[0].inputs())}
    leaves = jax.tree.leaves(examples[0])
    if any(id(leaves[number]) in inputs for number in made.read):
        raise UnknownOperationError("inputs of other samples")
    return made


def observed(model: Any, parameters: int, states: int) -> BySample:
    """The outputs of a model, for states along records.

    Args:
        model: A `FlightModel`.
        parameters: How many.
        states: Likewise.

    Raises:
        UnknownOperationError: If some operation has no scalar form.
    """
    begun = opening(model)
    key = kind_of(begun), parameters, states
    with _lock:
        if key not in _observed:
            examples = begun, np.zeros(parameters), np.zeros(states), _first_inputs(begun)
            try:
                made = _at_a_sample(_observe, examples, (SHARED, "theta", "x", "now"))
                _observed[key] = BySample(made, ("x", "now"))
            except UnknownOperationError as operation:
                _observed[key] = operation
        found = _observed[key]
    if isinstance(found, UnknownOperationError):
        raise found
    return found
