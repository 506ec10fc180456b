"""Covariances of the filter by machine code against one dense covariance of all states, taken on by the textbook."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.compiler.machine import aligned, compiled
from bayeschute.likelihood.filter_code.covariance_pass import GIVEN, Sizes, covariance_pass
from bayeschute.likelihood.filter_code.rows import padded

pytest.importorskip("llvmlite")

T = 5
SIZES = {  # own states, latent states, outputs, disturbances
    "one of each": (1, 1, 1, 1), "no latent state": (3, 0, 2, 1), "odd numbers": (5, 3, 2, 2),
    "more outputs than states": (2, 1, 6, 3), "whole registers": (4, 4, 4, 4), "rows in parts": (13, 2, 15, 2),
}  # fmt: skip
BY_STEP, UNTOUCHED = ("by_latent", "by_shock"), -77.0


@pytest.fixture(scope="module", params=SIZES.values(), ids=SIZES.keys())
def given(request):
    """Matrices at random; those of latent processes are independent of each other, unlike in a flight."""
    x, size, c, a = request.param
    rng, n = np.random.default_rng(x), x + size
    shapes = {
        "by_state": (T - 1, x, x), "by_now": (T - 1, x, a), "by_then": (T - 1, x, a), "out_state": (T, c, x),
        "latent": (a, size), "latent_then": (a, size), "latent_noise": (a, size), "transition": (size, size),
        "noise_gain": (size, size), "slack": (x,),
    }  # fmt: skip
    made = {name: 0.4 * rng.normal(size=shape) for name, shape in shapes.items()}
    root = rng.normal(size=(n, n))
    made["start"] = 0.5 * (root @ root.T) / n
    made |= {name: rng.uniform(0.3, 0.9, c) for name in ("kept", "fresh", "stationary")}
    seen = rng.random((T, c)) > 0.3
    seen[1], seen[2], seen[:, 0] = False, True, [True, False, True, True, True]
    made["seen"] = seen * 1.0
    made["white"] = np.where(seen, rng.uniform(0.2, 1.0, (T, c)), 1.0)
    return SimpleNamespace(**made, x=x, size=size, c=c, a=a, n=n, s=n + c)


def wide(matrix):
    made = np.zeros((len(matrix), padded(matrix.shape[1])))
    made[:, : matrix.shape[1]] = matrix
    return made


def run(given, slack=False, score=False, steps=T - 1):
    sizes = Sizes(given.x, given.size, given.c, given.a, slack, score)
    program = covariance_pass(sizes)
    made = {name: aligned(*shape) for name, shape in sizes.results(T).items()}
    arrays = [getattr(given, name) for name in GIVEN]
    arrays = [wide(a) if name.startswith("latent") else np.ascontiguousarray(a) for name, a in zip(GIVEN, arrays, strict=True)]  # fmt: skip
    scratch = np.full(program.scratch + 8, np.nan)  # what is left from before is no matter
    scratch[program.scratch :] = UNTOUCHED
    compiled(program)(*arrays, *made.values(), scratch, T, steps)
    assert (scratch[program.scratch :] == UNTOUCHED).all()
    return made


def dense(given, slack=False, steps=T - 1):
    """Every result, from predicted covariances (S, S) that are filtered and taken on as one."""
    x, n, s, c = given.x, given.n, given.s, given.c
    p = np.zeros((s, s))
    p[:n, :n], p[n:, n:] = given.start, np.diag(given.stationary)
    found = []
    for t in range(T):
        step = min(t, steps - 1)
        by_latent = given.by_now[step] @ given.latent + given.by_then[step] @ given.latent_then
        by_shock = given.by_then[step] @ given.latent_noise
        seen = given.seen[t]
        h = np.concatenate([seen[:, None] * given.out_state[t], np.zeros((c, given.size)), np.diag(seen)], axis=1)
        innovation = h @ p @ h.T + np.diag(given.white[t])
        root = np.linalg.cholesky(innovation)
        gain = p @ h.T @ np.linalg.inv(innovation)
        after = p - gain @ innovation @ gain.T
        f, noise = np.zeros((s, s)), np.zeros((s, s))
        f[:x, :x], f[:x, x:n], f[x:n, x:n], f[n:, n:] = given.by_state[step], by_latent, given.transition, np.diag(given.kept)  # fmt: skip
        effect = np.concatenate([by_shock, given.noise_gain])
        noise[:n, :n], noise[n:, n:] = effect @ effect.T, np.diag(given.fresh)
        noise[:x, :x] += np.diag(given.slack**2) * slack
        moved = f @ after
        found.append({
            "by_latent": by_latent, "by_shock": by_shock, "output": h[:, :x], "gain": gain, "root": root,
            "inverse": np.linalg.inv(root), "spread": p[:x], "latents": moved[:, x:n], "noises": moved[:, n:],
        })  # fmt: skip
        p = moved @ f.T + noise
    return {name: np.stack([one[name] for one in found[: T - (name in BY_STEP)]]) for name in found[0]}


@pytest.mark.parametrize("slack", [False, True])
@pytest.mark.parametrize("score", [False, True])
def test_all_results_are_those_of_dense_matrices(given, slack, score):
    made, wanted = run(given, slack, score), dense(given, slack)
    both = {"by_latent", "by_shock", "output", "gain", "root", "inverse"}
    assert set(made) == both | ({"latents", "noises"} if score else {"spread"})
    for name, a in made.items():
        assert a.shape == wanted[name].shape, name
        np.testing.assert_allclose(a, wanted[name], rtol=1e-9, atol=1e-11, err_msg=name)


def test_the_last_step_is_held_where_there_are_fewer(given):
    wanted = dense(given, steps=2)
    for name, a in run(given, steps=2).items():
        if name not in BY_STEP:
            np.testing.assert_allclose(a, wanted[name], rtol=1e-9, atol=1e-11, err_msg=name)


def test_slack_that_is_not_asked_for_does_nothing(given):
    other = SimpleNamespace(**vars(given) | {"slack": given.slack + 5.0})
    for name, a in run(given).items():
        np.testing.assert_array_equal(a, run(other)[name], err_msg=name)


def test_where_no_data_are_the_factor_is_one_and_nothing_is_corrected(given):
    made = run(given)
    np.testing.assert_array_equal(made["root"][1], np.eye(given.c))
    np.testing.assert_array_equal(made["inverse"][1], np.eye(given.c))
    assert not made["gain"][1].any() and not made["output"][1].any()
    np.testing.assert_array_equal(np.triu(made["root"], 1), 0.0)


def test_outputs_that_are_missing_may_be_anything(given):
    broken = np.where(given.seen[:, :, None] > 0.0, given.out_state, np.nan)
    made = run(SimpleNamespace(**vars(given) | {"out_state": broken}))
    for name, a in run(given).items():
        np.testing.assert_array_equal(a, made[name], err_msg=name)


def test_an_unstable_flight_keeps_its_covariance_symmetric():
    """States that double from sample to sample, seen through: rounding that is not alike on both sides would double too."""
    rng, samples, x = np.random.default_rng(3), 400, 3
    turn = np.linalg.qr(rng.normal(size=(x, x)))[0]
    sizes, zero = Sizes(x, 1, 2, 1), np.zeros((samples - 1, x, 1))
    made = {name: aligned(*shape) for name, shape in sizes.results(samples).items()}
    given = {
        "by_state": np.broadcast_to(2.0 * turn, (samples - 1, x, x)), "by_now": zero, "by_then": zero + 0.1,
        "out_state": rng.normal(size=(1, 2, x)) + np.zeros((samples, 1, 1)), "seen": np.ones((samples, 2)),
        "white": np.full((samples, 2), 0.01), "latent": np.ones((1, 4)), "latent_then": np.ones((1, 4)),
        "latent_noise": np.ones((1, 4)), "transition": np.full((1, 1), 0.9), "noise_gain": np.full((1, 1), 0.3),
        "slack": np.zeros(x), "kept": np.full(2, 0.5), "fresh": np.full(2, 0.1), "start": np.eye(x + 1),
        "stationary": np.full(2, 0.13),
    }  # fmt: skip
    program = covariance_pass(sizes)
    arrays = [np.ascontiguousarray(given[name]) for name in GIVEN]
    compiled(program)(*arrays, *made.values(), aligned(program.scratch), samples, samples - 1)
    own = made["spread"][:, :, :x]
    np.testing.assert_array_equal(own, np.swapaxes(own, 1, 2))
    assert (np.linalg.eigvalsh(own) > 0.0).all()
    np.testing.assert_allclose(own[-1], own[-2], rtol=1e-9)  # settled


def test_sizes_and_shapes():
    sizes = Sizes(5, 3, 2, 4)
    assert sizes.states == 10 and not sizes.slack and not sizes.score
    both = {
        "by_latent": (6, 5, 3), "by_shock": (6, 5, 3), "output": (7, 2, 5), "gain": (7, 10, 2), "root": (7, 2, 2),
        "inverse": (7, 2, 2),
    }  # fmt: skip
    assert sizes.results(7) == both | {"spread": (7, 5, 10)}
    assert sizes._replace(score=True).results(7) == both | {"latents": (7, 10, 3), "noises": (7, 10, 2)}
    assert covariance_pass(sizes) is covariance_pass(Sizes(5, 3, 2, 4))
