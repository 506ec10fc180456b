"""Compiled functions are let go only when memory maps are many, and work again afterwards; sums don't hang on cores."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable

import jax
import jax.numpy as jnp
import pytest

from bayeschute.core.numerics import THREADS_VARIABLE, clear_compiled

Doubling = tuple[Callable[[jax.Array], jax.Array], list[int]]


@pytest.fixture
def doubling() -> Doubling:
    """A compiled function, called once, and a list that grows whenever it is compiled."""
    traced = []

    @jax.jit
    def double(x: jax.Array) -> jax.Array:
        traced.append(1)
        return 2.0 * x

    double(jnp.ones(3))
    return double, traced


def test_few_maps_keep_compiled_functions(doubling: Doubling) -> None:
    double, traced = doubling
    assert not clear_compiled(10**9)
    double(jnp.ones(3))
    assert len(traced) == 1


def test_many_maps_let_them_go_and_they_are_made_anew(doubling: Doubling) -> None:
    double, traced = doubling
    assert clear_compiled(0)
    assert double(jnp.ones(3)).tolist() == [2.0, 2.0, 2.0]
    assert len(traced) == 2


FREED = """
import ctypes, os
from bayeschute.core.numerics import clear_compiled

def resident():
    with open("/proc/self/statm") as told:
        return int(told.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

c = ctypes.CDLL(None)
c.malloc.restype, c.free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
blocks = [c.malloc(1000) for _ in range(100_000)]
for block in blocks:
    ctypes.memset(block, 1, 1000)
above = c.malloc(1000)
for block in blocks:
    c.free(block)
before = resident()
clear_compiled(0)
print(before - resident())
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="needs glibc")
def test_what_was_freed_is_given_back() -> None:
    """Small blocks below one that is still in use: freed, but kept by the process until glibc is told."""
    done = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True)
    assert int(done.stdout) > 0.8 * 1000 * 100_000


PRODUCT = """
import os, sys
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv[1])])
import bayeschute.core.numerics
import jax, jax.numpy as jnp, numpy as np
tall = jnp.asarray(np.random.default_rng(0).standard_normal((10_800, 15)))
print(np.asarray(jax.jit(lambda a: a.T @ a)(tall)).tobytes().hex())
"""


@pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity") or len(os.sched_getaffinity(0)) < 2, reason="one core, or can't tell"
)
def test_sums_are_rounded_alike_on_one_core_and_on_two() -> None:
    here = {name: value for name, value in os.environ.items() if name != THREADS_VARIABLE}
    made = [
        subprocess.run([sys.executable, "-c", PRODUCT, cores], env=here, capture_output=True, text=True, check=True)
        for cores in ("1", "2")
    ]
    assert made[0].stdout and made[0].stdout == made[1].stdout
