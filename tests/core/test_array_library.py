"""Which library functions of numbers and of traced arrays are given."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.core.array_library import library_of, traced


def test_numbers_of_any_kind_are_numpy_s():
    assert library_of(1.0, [np.ones(3), {"a": jnp.ones(2)}], None) is np
    assert not traced()


def test_one_traced_number_among_known_ones_is_jax_s():
    seen = []

    @jax.jit
    def function(a):
        seen.append((library_of(np.ones(2), (a, 1.0)), library_of(np.ones(2)), traced({"deep": [a]})))
        return a

    function(1.0)
    jax.grad(function)(1.0)
    assert seen[0] == (jnp, np, True) and seen[-1] == (jnp, np, True)
