"""The filter's passes over a flight by machine code, from arrays to arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.emit import Program
from bayeschute.compiler.integrate import Steps
from bayeschute.compiler.machine import aligned, compiled
from bayeschute.likelihood.disturbances import Dynamics
from bayeschute.likelihood.filter_code.covariance_pass import Sizes, covariance_pass
from bayeschute.likelihood.filter_code.mean_passes import SYSTEM, MeanSizes, backward_pass, forward_pass
from bayeschute.likelihood.filter_code.rows import padded, parts
from bayeschute.likelihood.filter_code.score_pass import score_pass
from bayeschute.likelihood.noise import Noise

Array = NDArray[np.float64]


def covariances(
    steps: Steps,
    start: Array,
    first: Array,
    latent: Dynamics,
    noise: Noise,
    dt: float,
    here: Any,
    slack: Any,
    score: bool,
) -> dict[str, Array]:
    """Run the covariances of the filter: results of `covariance_pass` by name, ``kept`` and ``seen``.

    Args:
        steps: The linearised flight.
        start: Effect of the standardised initial deviations on the first state (S, D).
        first: Effect of the first process noise on it (S, W).
        latent: Processes.
        noise: Residual noise per output.
        dt: Sample interval [s].
        here: Which data exist (T, C).
        slack: Standard deviations of additional white process noise of the flight's own states (X,), or None.
        score: As in `covariance_pass.Sizes`.
    """
    (samples, outputs), own = np.shape(here), np.shape(steps.by_state)[1]
    output, transition, gain = (_array(a) for a in (latent.output, latent.transition, latent.noise_gain))
    sizes = Sizes(own, len(transition), outputs, len(output), slack is not None, score)
    kept = _array(np.broadcast_to(np.exp(-dt / _array(noise.time_constant)), outputs))
    stationary = np.broadcast_to(_array(noise.correlated) ** 2, outputs)
    seen, body = np.asarray(here) * 1.0, own + len(transition)
    given = (
        steps.by_state, steps.by_now, steps.by_then, steps.out_state, seen,
        np.where(seen > 0.0, _array(noise.white) ** 2, 1.0), _wide(output), _wide(output @ transition),
        _wide(output @ gain), transition, gain, _array([] if slack is None else slack), kept,
        (1.0 - kept**2) * stationary, start[:body] @ start[:body].T + first[:body] @ first[:body].T, stationary,
    )  # fmt: skip
    program = covariance_pass(sizes)
    made = {name: aligned(*shape) for name, shape in sizes.results(samples).items()}
    _run(program, given, tuple(made.values()), samples)
    return made | {"kept": kept, "seen": seen}


def forward(made: Any, series: Any, inputs: Any, told: int) -> tuple[Array, ...]:
    """`kalman.forward` of series (T, C, M)."""
    driven = 0 if inputs is None else np.shape(inputs)[1]
    found = []
    for part in _in_parts(np.shape(series)[2]):
        given = [_array(np.asarray(a)[:, :, part]) for a in ([series] if inputs is None else [series, inputs])]
        samples, outputs, columns = given[0].shape
        sizes = _sizes(made, columns, driven)
        results = [aligned(samples, rows, columns) for rows in (outputs, outputs, told)]
        last = [np.zeros(0)] if inputs is None else []
        _run(forward_pass(sizes, told), (*_system(made), made.inverse, *given, *last), results, samples)
        found.append(results)
    return _joined(found)


def backward(made: Any, weighted: Any, predicted: Any) -> tuple[Array, ...]:
    """`kalman.backward`: adjoint vectors of the first sample, process noise but the first, and states."""
    found = []
    slack = _array([] if made.slack is None else made.slack)
    for part in _in_parts(np.shape(weighted)[2]):
        given = [_array(np.asarray(a)[:, :, part]) for a in (weighted, predicted)]
        samples, _, columns = given[0].shape
        sizes = _sizes(made, columns)._replace(slack=made.slack is not None)
        shapes = ((1, sizes.states), (samples, sizes.latent + sizes.own * sizes.slack), (samples, sizes.own))
        results = [aligned(*shape, columns) for shape in shapes]
        more = (made.by_shock, made.noise_gain, slack, made.spread)
        _run(backward_pass(sizes), (*_system(made), *more, *given), results, samples)
        found.append(results)
    adjoint, process_noise, states = _joined(found)
    return adjoint[0], process_noise, states


def score(made: Any, series: Any, latents: Any, noises: Any) -> tuple[Array, ...]:
    """Sums of `kalman_gradient.slope` along its `_Series`, and the adjoint of the first covariance."""
    samples, _, columns = np.shape(series.weighted)
    sizes = _sizes(made, columns)
    size, outputs, states = sizes.latent, sizes.outputs, sizes.states
    shapes = ((size, size), (size, size), (outputs,), (outputs,), (outputs,), (states, states))
    results = [aligned(*shape) for shape in shapes]
    given = (*_system(made), series.inner, series.weighted, latents, noises, series.means, series.way)
    _run(score_pass(sizes), given, results, samples)
    return tuple(results)


def _sizes(made: Any, columns: int, driven: int = 0) -> MeanSizes:
    _, outputs, own = np.shape(made.output)
    return MeanSizes(own, len(made.transition), outputs, columns, driven)


def _system(made: Any) -> list[Any]:
    return [getattr(made, name) for name in SYSTEM]


def _in_parts(columns: int) -> list[slice]:
    """Columns that a pass takes at once."""
    return [slice(first, first + count) for first, count in parts(padded(columns))]


def _joined(found: list[list[Array]]) -> tuple[Array, ...]:
    return tuple(a[0] if len(a) == 1 else np.concatenate(a, axis=2) for a in zip(*found, strict=True))


def _run(program: Program, given: Sequence[Any], results: Sequence[Array], samples: int) -> None:
    arrays = [_array(a) for a in given]
    compiled(program)(*arrays, *results, aligned(program.scratch), samples, len(arrays[0]))


def _array(a: Any) -> Array:
    return np.ascontiguousarray(a, float)


def _wide(a: Array) -> Array:
    """A matrix whose rows fill whole registers."""
    made = aligned(len(a), padded(a.shape[1]))
    made[:, : a.shape[1]] = a
    return made
