"""Simulation of a flight and its derivatives by compiled machine code; same numbers as `integrate`.

The code is generated from the operations that JAX traces in a model's `rate` and `observe`, each evaluated once, for
several flights or samples side by side (SIMD). It takes concrete arrays on a CPU, for models whose `advance` is `rk4`
of their `rate`, where llvmlite can be imported (it is a dependency). Otherwise the functions here return
None and `integrate` does the same more slowly; `why_not_compiled` gives the reason.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from bayeschute.compiler import integrate
from bayeschute.compiler.integrate import FlightModel, Steps
from bayeschute.compiler.machine import Array, aligned, in_parts, padded, takes
from bayeschute.compiler.programs import LANES, Programs, observed, opening, programs_of
from bayeschute.compiler.trace import UnknownOperationError
from bayeschute.core.array_library import traced

_DRIVEN = ("theta", "error_now", "error_then")


def _served(model: FlightModel, theta: Any, start: Any, error: Any) -> Programs | str:
    """Programs for a call, or why there are none."""
    if traced(model, theta, start, error):
        return "the call is traced"
    batch = np.shape(theta)[1:]
    if len(batch) > 1 or np.shape(start)[1:] != batch or np.shape(error)[2:] != batch:
        return "there is more than one batch axis, or not the same everywhere"
    return programs_of(model, theta, start, error)


def programs_for(model: FlightModel, theta: Any, start: Any, error: Any) -> Programs | None:
    """Programs of a flight; None where there is an `why_not_compiled`. Arguments as of `states`."""
    found = _served(model, theta, start, error)
    return None if isinstance(found, str) else found


def why_not_compiled(model: FlightModel, theta: Any, start: Any, error: Any) -> str | None:
    """Why a flight isn't simulated by machine code, in words; None where it is. Arguments as of `states`."""
    found = _served(model, theta, start, error)
    return found if isinstance(found, str) else None


def states(model: FlightModel, theta: Any, start: Any, error: Any, given: Any = None) -> Array | None:
    """States at every sample, as `integrate.trajectory`.

    Args:
        model: The flight.
        theta: Parameters (P,) or (P, B).
        start: Initial deviations (D,) or (D, B).
        error: Latent disturbances (T, A) or (T, A, B).
        given: States known at the first samples (K, X) or (K, X, B); the simulation goes on from the last of them.

    Returns:
        States (T, X) or (T, X, B), or None where there is an `why_not_compiled`.
    """
    programs = _served(model, theta, start, error)
    if isinstance(programs, str):
        return None
    made, first = _states(programs, model, theta, start, error, given), given
    if first is not None:
        made[: len(first)] = np.asarray(first)
    return made


def reached(model: FlightModel, theta: Any, start: Any, error: Any, path: Any) -> integrate.Reached | None:
    """Where every step leads from the states of a path, as `integrate.reached`.

    Args:
        model: The flight.
        theta: Parameters (P,) or (P, B).
        start: Initial deviations (D,) or (D, B).
        error: Latent disturbances (T, A) or (T, A, B).
        path: States (T, X) or (T, X, B).

    Returns:
        States reached, or None where there is an `why_not_compiled`.
    """
    programs = _served(model, theta, start, error)
    if isinstance(programs, str):
        return None
    made = _states(programs, model, theta, start, error, path)
    return integrate.Reached(made[0], made[1:])


def outputs(model: FlightModel, theta: Any, path: Any) -> Array | None:
    """Outputs of the states of a path, as `integrate.outputs`.

    Args:
        model: The flight.
        theta: Parameters (P,) or (P, B).
        path: States (T, X) or (T, X, B).

    Returns:
        Outputs (T, C) or (T, C, B), or None where no code can be generated or JAX is tracing.
    """
    if jax.default_backend() != "cpu" or np.ndim(path) > 3 or not takes(model, theta, path):
        return None
    try:
        function = observed(model, np.shape(theta)[0], np.shape(path)[1])
    except UnknownOperationError:
        return None
    return function.at(model, {"theta": theta, "x": path, "now": _record(model)})


def along_path(
    model: FlightModel, theta: Any, start: Any, error: Any, path: Any, by_theta: bool = True
) -> tuple[Array, integrate.Reached, Steps] | None:
    """Outputs, where every step leads and all derivatives along a given path, as `integrate.along_path`.

    Args:
        model: The flight.
        theta: Parameters (P,).
        start: Initial deviations (D,).
        error: Latent disturbances (T, A).
        path: States (T, X), which need not obey the equations of motion.
        by_theta: Whether the steps' derivatives by parameters are wanted: cheaper without, P = 0.

    Returns:
        Outputs (T, C), states reached and derivatives, or None where there is an `why_not_compiled`.

    Raises:
        ValueError: If the shape of the path does not fit the samples and states.
    """
    programs = _served(model, theta, start, error)
    if isinstance(programs, str) or np.ndim(theta) != 1:
        return None
    made = arrays_along(programs, model, theta, start, error, path, by_theta=by_theta)
    y, reached, steps = made
    return y, integrate.Reached(reached[0], reached[1:]), steps


def arrays_along(
    programs: Programs, model: Any, theta: Any, start: Any, error: Any, path: Any, *, by_theta: bool = True
) -> tuple[Array, Array, Steps]:
    """`along_path` in NumPy arrays alone, as a function that JAX calls back must be: states reached are (T, X)."""
    size = len(programs.first.result)
    if np.shape(path) != (np.shape(error)[0], size):
        raise ValueError(f"a path of shape {np.shape(path)} for {np.shape(error)[0]} samples of {size} states")
    along = _Along(programs, model, theta, error, np.asarray(path, float))
    slopes_by_theta, by_now, by_then, by_state = along.slopes(by_theta)
    y, out_state, out_theta = along.outputs()
    first, first_theta, first_start = _first_slopes(programs, model, theta, start)
    reached = np.concatenate([first[None], along.reached[:, : len(path) - 1].T])
    if not by_theta:
        first_theta, out_theta = first_theta[:, :0], out_theta[:, :, :0]
    parts: Any = (by_state, slopes_by_theta, by_now, by_then, first_theta, first_start, out_state, out_theta)
    return y, reached, Steps(*parts)


def _record(model: Any) -> Array:
    """Inputs at the samples (T, R)."""
    leaves = [np.asarray(leaf, float) for leaf in jax.tree.leaves(model.inputs())]
    return np.ascontiguousarray(np.concatenate([leaf.reshape(len(leaf), -1) for leaf in leaves], axis=1))


def _handed_over(part: Array) -> Array:
    """A copy of a part of an array, its numbers side by side as the passes of the filter want them."""
    made = aligned(*part.shape)
    made[...] = part
    return made


def _columns(parts: list[Array]) -> Array:
    """Columns side by side (X, M) as blocks (M / lanes, X, lanes)."""
    whole = np.concatenate(parts, axis=1)
    blocks = -(-whole.shape[1] // LANES)
    made = aligned(blocks, whole.shape[0], LANES)
    wide = np.zeros((whole.shape[0], blocks * LANES))
    wide[:, : whole.shape[1]] = whole
    made[:] = wide.reshape(-1, blocks, LANES).swapaxes(0, 1)
    return made


def _first_slopes(programs: Programs, model: Any, theta: Any, start: Any) -> tuple[Array, Array, Array]:
    """The first state (X,) and its derivatives by parameters (X, P) and by deviations (X, D)."""
    made, traced, size = programs.begin_slopes(), programs.first, len(programs.first.result)
    first, by_theta, by_start = aligned(size), aligned(size, np.size(theta)), aligned(size, np.size(start))
    given = traced.shared(opening(model)), np.array(theta, float), np.array(start, float)
    made.call(*given, first, by_theta, by_start, aligned(made.scratch), 1, 0, 1)
    return first, by_theta, by_start


def _states(programs: Programs, model: Any, theta: Any, start: Any, error: Any, path: Any = None) -> Array:
    """The first state, and where the steps lead: from a path as far as it goes, then from where the last one led."""
    batch = np.shape(theta)[1:]
    count = batch[0] if batch else 1
    lanes = 1 if count == 1 else LANES
    stride, blocks = -(-count // lanes) * lanes, -(-count // lanes)
    theta, start, error = (
        padded(np.reshape(np.asarray(a, float), (*np.shape(a)[:k], count)), stride)
        for a, k in ((theta, 1), (start, 1), (error, 2))
    )
    samples, size = len(error), len(programs.first.result)
    begin, first = programs.begin(lanes), aligned(stride, size)
    shared = programs.first.shared(opening(model))
    begin.call(shared, theta, start, first, aligned(begin.scratch), stride, 0, blocks)
    made = aligned(samples, size, stride)
    made[0] = first.T
    known = made[:1].copy() if path is None else np.reshape(np.asarray(path, float), (len(path), size, count))
    known = padded(known, stride)
    simulate, shared, record = programs.simulate(lanes), programs.rate.shared(model), _record(model)
    plan = model.stepping.plan(float(model.dt))

    def work(begin: int, end: int) -> None:
        sizes = samples, stride, begin, end, model.stepping.substeps, plan.shape[1], len(known)
        simulate.call(shared, theta, record, error, plan, known, made, aligned(simulate.scratch), *sizes)

    in_parts(blocks, work)
    return made[..., :count].reshape(samples, size, *batch)


class _Along:
    """A known flight with its samples side by side; `reached` (X, stride): where every step leads, after `slopes`."""

    def __init__(self, programs: Programs, model: Any, theta: Any, error: Any, x: Array) -> None:
        self.model, self.x, self.theta = model, x, np.array(theta, float, order="C")
        self.programs = programs
        self.rows = self.programs.rate.rows
        self.blocks = -(-len(x) // LANES)
        self.stride = (self.blocks + 1) * LANES
        self.record, self.error, self.states = (
            padded(a.T, self.stride) for a in (_record(model), np.asarray(error), x)
        )
        self.reached = aligned(x.shape[1], self.stride)

    def slopes(self, by_theta: bool = True) -> list[Array]:
        """Every next state by parameters, by disturbances at the sample and the next one, by state (T - 1, X, ...)."""
        model, made = self.model, self.programs.differentiate(_DRIVEN)
        size, columns = self.x.shape[1], [self.rows[group] for group in _DRIVEN]
        source = _columns([np.zeros((size, sum(columns))), np.eye(size)])
        blocks, wanted = len(source), 0 if by_theta else columns[0] // LANES
        out = aligned(self.blocks * LANES, size, blocks * LANES)
        shared = self.programs.rate.shared(model)
        plan = model.stepping.plan(float(model.dt))

        def work(begin: int, end: int) -> None:
            memory = aligned(made.table * model.stepping.substeps * plan.shape[1]), aligned(made.scratch)
            known = shared, self.theta, self.record, self.error, plan, self.states
            sizes = self.stride, begin, end, model.stepping.substeps, plan.shape[1], wanted, blocks
            made.call(*known, source, out, self.reached, *memory, *sizes)

        in_parts(self.blocks, work)
        parts = np.split(out[: len(self.x) - 1], np.cumsum([*columns, size]), axis=2)
        if not by_theta:
            parts[0] = parts[0][..., :0]
        return [_handed_over(part) for part in parts[:-1]]

    def outputs(self) -> tuple[Array, Array, Array]:
        """Outputs (T, C) and their derivatives by state (T, C, X) and parameters (T, C, P)."""
        made, traced = self.programs.observe(), self.programs.outputs
        total, count = self.blocks * LANES, len(traced.result)
        y, by_state, by_theta = (aligned(total, count, *s) for s in ((), (self.x.shape[1],), (self.theta.size,)))
        shared, scratch = traced.shared(self.model), aligned(made.scratch)
        places = shared, self.theta, self.states, self.record, y, by_state, by_theta, scratch
        made.call(*places, self.stride, 0, self.blocks)
        count = len(self.x)
        return y[:count], by_state[:count], by_theta[:count]
