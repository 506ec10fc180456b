"""Means of filter and smoother by machine code against the textbook's matrices, whose numbers obey no filter."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.compiler.machine import aligned, compiled
from bayeschute.likelihood.filter_code.mean_passes import SYSTEM, MeanSizes, backward_pass, forward_pass

pytest.importorskip("llvmlite")

T = 5
SIZES = {  # own states, latent states, outputs, columns
    "one of each": (1, 1, 1, 1), "no latent state": (3, 0, 2, 4), "odd numbers": (5, 3, 2, 7),
    "more outputs than states": (2, 1, 6, 9), "whole registers": (4, 4, 4, 8),
}  # fmt: skip
UNTOUCHED = -77.0


@pytest.fixture(scope="module", params=SIZES.values(), ids=SIZES.keys())
def given(request):
    """Matrices at random: nothing of a covariance or a gain is in them, so that each has its own part."""
    x, latent, c, columns = request.param
    rng, s = np.random.default_rng(x + 10 * columns), x + latent + c
    shapes = {
        "by_state": (T - 1, x, x), "by_latent": (T - 1, x, latent), "transition": (latent, latent), "kept": (c,),
        "output": (T, c, x), "gain": (T, s, c), "inverse": (T, c, c), "series": (T, c, columns),
        "by_shock": (T - 1, x, latent), "noise_gain": (latent, latent), "slack": (x,), "spread": (T, x, s),
        "weighted": (T, c, columns), "predicted": (T, x, columns),
    }  # fmt: skip
    made = {name: 0.5 * rng.normal(size=shape) for name, shape in shapes.items()}
    seen = rng.random((T, c)) > 0.3
    seen[1], seen[2], seen[:, 0] = False, True, [True, False, True, True, True]
    made["seen"], made["inputs"] = seen * 1.0, rng.normal(size=(T, s, columns))
    return SimpleNamespace(**made, x=x, latent=latent, c=c, columns=columns, s=s, n=x + latent)


def run(program, given, names, shapes, steps=T - 1):
    made = [np.full(shape, UNTOUCHED) for shape in shapes]
    arrays = [np.ascontiguousarray(getattr(given, name)) for name in (*SYSTEM, *names)]
    scratch = aligned(program.scratch)
    scratch[:] = np.nan  # what is left from before is no matter
    compiled(program)(*arrays, *made, scratch, T, steps)
    return made


def transition(given, t):
    """Of all states, from a sample to the next."""
    f, x, n = np.zeros((given.s, given.s)), given.x, given.n
    f[:x, :x], f[:x, x:n], f[x:n, x:n] = given.by_state[t], given.by_latent[t], given.transition
    f[n:, n:] = np.diag(given.kept)
    return f


def seen_by(given, t):
    """All outputs by all states."""
    return np.concatenate([given.output[t], np.zeros((given.c, given.latent)), np.diag(given.seen[t])], axis=1)


def filtered(given, driven, steps=T - 1):
    """Scaled and weighted innovations, and predicted means, sample by sample."""
    mean, found = np.zeros((given.s, given.columns)), []
    for t in range(T):
        mean[:driven] += given.inputs[t, :driven]
        off = given.seen[t][:, None] * given.series[t] - given.seen[t][:, None] * (seen_by(given, t) @ mean)
        unit = given.inverse[t] @ off
        found.append((unit, given.inverse[t].T @ unit, mean.copy()))
        mean = mean + given.gain[t] @ off
        if t < T - 1:
            mean = transition(given, min(t, steps - 1)) @ mean
    return [np.stack(part) for part in zip(*found, strict=True)]


@pytest.mark.parametrize("driven", ["none", "own", "all"])
def test_the_filters_means(given, driven):
    """Output matrices are those where data exist, as the filter has them; of others no innovation is made."""
    count = {"none": 0, "own": given.x, "all": given.s}[driven]
    for told in (0, 1, given.s):
        sizes = MeanSizes(given.x, given.latent, given.c, given.columns, count)
        one = SimpleNamespace(**vars(given) | {"inputs": given.inputs[:, :count]})
        shapes = ((T, given.c, given.columns),) * 2 + ((T, told, given.columns),)
        made = run(forward_pass(sizes, told), one, ("inverse", "series", "inputs"), shapes)
        unit, weighted, mean = filtered(given, count)
        np.testing.assert_allclose(made[0], unit, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(made[1], weighted, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(made[2], mean[:, :told], rtol=1e-11, atol=1e-12)


def test_what_is_missing_may_be_anything(given):
    series = np.where(given.seen[:, :, None] > 0.0, given.series, np.nan)
    sizes = MeanSizes(given.x, given.latent, given.c, given.columns)
    shapes = ((T, given.c, given.columns),) * 2 + ((T, given.s, given.columns),)
    names = ("inverse", "series", "inputs")
    whole, gaps = (
        run(forward_pass(sizes, given.s), SimpleNamespace(**vars(given) | {"series": z}), names, shapes)
        for z in (given.series, series)
    )
    for a, b in zip(whole, gaps, strict=True):
        np.testing.assert_array_equal(a, b)


def smoothed(given, slack, steps=T - 1):
    """Durbin and Koopman (2012), section 4.4, with the transition after each sample taken first."""
    adjoint, shocks, states = np.zeros((given.s, given.columns)), {}, {}
    for t in reversed(range(T)):
        step, x = min(t, steps - 1), given.x
        if t < T - 1:
            effect = np.concatenate([given.by_shock[step], given.noise_gain, np.zeros((given.c, given.latent))])
            shocks[t + 1] = effect.T @ adjoint
            if slack:
                shocks[t + 1] = np.concatenate([shocks[t + 1], given.slack[:, None] * adjoint[:x]])
        back = transition(given, step).T @ adjoint
        adjoint = back + seen_by(given, t).T @ (given.weighted[t] - given.gain[t].T @ back)
        states[t] = given.predicted[t] + given.spread[t] @ adjoint
    return adjoint, shocks, np.stack([states[t] for t in range(T)])


@pytest.mark.parametrize("slack", [False, True])
def test_the_smoother(given, slack):
    sizes = MeanSizes(given.x, given.latent, given.c, given.columns, slack=slack)
    wide = given.latent + given.x * slack
    shapes = ((given.s, given.columns), (T, wide, given.columns), (T, given.x, given.columns))
    names = ("by_shock", "noise_gain", "slack", "spread", "weighted", "predicted")
    first, shocks, states = run(backward_pass(sizes), given, names, shapes)
    adjoint, wanted, means = smoothed(given, slack)
    np.testing.assert_allclose(first, adjoint, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(shocks[1:], np.stack([wanted[t] for t in range(1, T)]), rtol=1e-11, atol=1e-12)
    assert (shocks[0] == UNTOUCHED).all()  # that of the first sample is no part of it
    np.testing.assert_allclose(states, means, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("steps", [1, 2])
def test_the_last_step_is_held_where_there_are_fewer(given, steps):
    sizes = MeanSizes(given.x, given.latent, given.c, given.columns, 0)
    shapes = ((T, given.c, given.columns),) * 2 + ((T, given.s, given.columns),)
    made = run(forward_pass(sizes, given.s), given, ("inverse", "series", "inputs"), shapes, steps)
    for got, want in zip(made, filtered(given, 0, steps), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-11, atol=1e-12)
    shapes = ((given.s, given.columns), (T, given.latent, given.columns), (T, given.x, given.columns))
    names = ("by_shock", "noise_gain", "slack", "spread", "weighted", "predicted")
    first, _, states = run(backward_pass(sizes), given, names, shapes, steps)
    adjoint, _, means = smoothed(given, False, steps)
    np.testing.assert_allclose(first, adjoint, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(states, means, rtol=1e-11, atol=1e-12)


def test_sizes_add_up():
    sizes = MeanSizes(5, 3, 2, 7)
    assert (sizes.body, sizes.states, sizes.driven, sizes.slack) == (8, 10, 0, False)
    assert forward_pass(sizes, 2) is forward_pass(MeanSizes(5, 3, 2, 7), 2) is not forward_pass(sizes, 1)
    assert backward_pass(sizes) is not backward_pass(sizes._replace(slack=True))


@pytest.mark.parametrize("columns", [1, 4, 7])
def test_no_more_memory_is_used_than_is_asked_for(columns):
    """What lies behind scratch and results stays as it is."""
    sizes, told, rng = MeanSizes(3, 1, 2, columns, 3, True), 3, np.random.default_rng(0)
    shapes = dict(zip(SYSTEM, ((T - 1, 3, 3), (T - 1, 3, 1), (1, 1), (2,), (T, 2, 3), (T, 2), (T, 6, 2)), strict=True))
    ahead = {"inverse": (T, 2, 2), "series": (T, 2, columns), "inputs": (T, 3, columns)}
    back = {"by_shock": (T - 1, 3, 1), "noise_gain": (1, 1), "slack": (3,), "spread": (T, 3, 6)}
    back |= {"weighted": (T, 2, columns), "predicted": (T, 3, columns)}
    for program, more, results in (
        (forward_pass(sizes, told), ahead, ((T, 2, columns), (T, 2, columns), (T, told, columns))),
        (backward_pass(sizes), back, ((6, columns), (T, 4, columns), (T, 3, columns))),
    ):
        arrays = [0.3 * rng.normal(size=shape) for shape in (shapes | more).values()]
        arrays[5][:] = 1.0
        sizes_of = [*map(np.prod, results), program.scratch]
        held = [np.full(int(size) + 8, UNTOUCHED) for size in sizes_of]
        compiled(program)(*arrays, *held, T, T - 1)
        for a, size in zip(held, sizes_of, strict=True):
            assert (a[int(size) :] == UNTOUCHED).all()
