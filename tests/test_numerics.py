"""Compiled functions are let go only when memory maps are many, and work again afterwards."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import pytest

from bayeschute.numerics import let_go

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
    assert not let_go(10**9)
    double(jnp.ones(3))
    assert len(traced) == 1


def test_many_maps_let_them_go_and_they_are_made_anew(doubling: Doubling) -> None:
    double, traced = doubling
    assert let_go(0)
    assert double(jnp.ones(3)).tolist() == [2.0, 2.0, 2.0]
    assert len(traced) == 2
