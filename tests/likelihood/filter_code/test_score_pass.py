"""The adjoint pass by machine code against dense adjoints, step by step as they are derived."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.compiler.machine import aligned, compiled
from bayeschute.likelihood.filter_code.mean_passes import SYSTEM, MeanSizes
from bayeschute.likelihood.filter_code.score_pass import score_pass

pytest.importorskip("llvmlite")

T, UNTOUCHED = 5, -77.0
SIZES = {  # own states, latent states, outputs, columns
    "one of each": (1, 1, 1, 1), "no latent state": (3, 0, 2, 4), "odd numbers": (5, 3, 2, 7),
    "more outputs than states": (2, 1, 6, 9), "whole registers": (4, 4, 4, 8), "columns in parts": (3, 2, 2, 50),
}  # fmt: skip


@pytest.fixture(scope="module", params=SIZES.values(), ids=SIZES.keys())
def given(request):
    """Matrices at random: no filter made them, so that each has its own part."""
    x, latent, c, columns = request.param
    return system(x, latent, c, columns)


def system(x, latent, c, columns):
    rng, n, s = np.random.default_rng(x + columns), x + latent, x + latent + c
    shapes = {
        "by_state": (T - 1, x, x), "by_latent": (T - 1, x, latent), "transition": (latent, latent), "kept": (c,),
        "output": (T, c, x), "gain": (T, s, c), "weighted": (T, c, columns), "latents": (T, s, latent),
        "noises": (T, s, c), "means": (T, columns, latent + c), "way": (T - 1, x, latent),
    }  # fmt: skip
    made = {name: 0.4 * rng.normal(size=shape) for name, shape in shapes.items()}
    inner = rng.normal(size=(T, c, c))
    made["inner"] = inner + np.swapaxes(inner, 1, 2)
    seen = rng.random((T, c)) > 0.3
    seen[1], seen[2], seen[:, 0] = False, True, [True, False, True, True, True]
    made["seen"] = seen * 1.0
    return SimpleNamespace(**made, x=x, latent=latent, c=c, columns=columns, n=n, s=s)


def run(given, steps=T - 1):
    sizes = MeanSizes(given.x, given.latent, given.c, given.columns)
    program, latent, c = score_pass(sizes), given.latent, given.c
    names = (*SYSTEM, "inner", "weighted", "latents", "noises", "means", "way")
    made = [aligned(*shape) for shape in ((latent, latent), (latent, latent), (c,), (c,), (c,), (given.s, given.s))]
    scratch = np.full(program.scratch + 8, np.nan)  # what is left from before is no matter
    scratch[program.scratch :] = UNTOUCHED
    arrays = [np.ascontiguousarray(getattr(given, name)) for name in names]
    compiled(program)(*arrays, *made, scratch, T, steps)
    assert (scratch[program.scratch :] == UNTOUCHED).all()
    return made


def dense(given, steps=T - 1):
    """Adjoints z of the predicted covariance and r of the mean: z = L' z L + H' (S^-1 - w w') H - H' w u' - u w' H.

    There L is the transition times one less gain times output, and u = L' r.
    """
    x, n, s, size = given.x, given.n, given.s, given.latent
    z, r = np.zeros((s, s)), np.zeros((s, given.columns))
    sums = [np.zeros((size, size)), np.zeros((size, size)), *(np.zeros(given.c) for _ in range(3))]
    for t in reversed(range(T)):
        step, seen, w = min(t, steps - 1), given.seen[t], given.weighted[t]
        way = np.concatenate([given.way[step], np.eye(size)])  # of the latent processes into own and latent states
        sums[0] += way.T @ z[:n] @ given.latents[t] - way.T @ r[:n] @ given.means[t][:, :size]
        sums[1] += way.T @ z[:n, :n] @ way
        sums[2] += np.diagonal(z[n:] @ given.noises[t] - r[n:] @ given.means[t][:, size:])
        sums[3] += np.diagonal(z)[n:]
        f = np.zeros((s, s))
        f[:x, :x], f[:x, x:n], f[x:n, x:n] = given.by_state[step], given.by_latent[step], given.transition
        f[n:, n:] = np.diag(given.kept)
        h = np.concatenate([given.output[t], np.zeros((given.c, size)), np.diag(seen)], axis=1)
        back, gain = f.T @ z @ f, given.gain[t]
        sums[4] += 0.5 * seen * np.diagonal(given.inner[t] + gain.T @ back @ gain + 2.0 * w @ (gain.T @ f.T @ r).T)
        through = f @ (np.eye(s) - gain @ h)
        u = through.T @ r
        z = through.T @ z @ through + h.T @ given.inner[t] @ h - h.T @ w @ u.T - u @ w.T @ h
        r = u + h.T @ w
    return [*sums, z]


def test_sums_and_adjoint_are_those_of_dense_matrices(given):
    for name, got, want in zip(("latent", "noise gain", "kept", "drift", "white", "adjoint"), run(given), dense(given), strict=True):  # fmt: skip
        np.testing.assert_allclose(
            got, want, rtol=1e-9, atol=1e-10 * (1.0 + np.abs(want).max(initial=0.0)), err_msg=name
        )


def test_the_last_step_is_held_where_there_are_fewer(given):
    for got, want in zip(run(given, 2), dense(given, 2), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-10 * (1.0 + np.abs(want).max(initial=0.0)))


def test_states_in_parts():
    """More than registers take at once."""
    given = system(14, 2, 34, 3)
    for got, want in zip(run(given), dense(given), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-10 * (1.0 + np.abs(want).max(initial=0.0)))


def test_the_adjoint_is_exactly_symmetric(given):
    adjoint = run(given)[-1]
    np.testing.assert_array_equal(adjoint, adjoint.T)


def test_derivatives_by_white_noise_are_of_data_that_exist():
    """One output, seen at the first sample alone: half the innovation's part there, whatever the rest would be."""
    given = system(2, 1, 1, 3)
    given.seen[:] = 0.0
    given.seen[0] = 1.0
    given.inner[:] = 3.0
    given.gain[1:], given.gain[0] = 0.0, 0.0
    given.weighted[1:], given.output[1:] = 0.0, 0.0
    white = run(given)[4]
    np.testing.assert_allclose(white, 0.5 * 3.0, rtol=1e-14)


def test_a_pass_is_written_once():
    assert (
        score_pass(MeanSizes(2, 1, 1, 3)) is score_pass(MeanSizes(2, 1, 1, 3)) is not score_pass(MeanSizes(2, 1, 1, 4))
    )
