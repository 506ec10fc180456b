"""NumPy where numbers are known, JAX where they are being traced.

What is not differentiated needs no compiled function: XLA takes a tenth of a second for one, and makes it again for
every number of samples, parameters and columns, which is most of what a first run waits for. A function that is
differentiated in one place and called with numbers in another asks here for its library.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def traced(*given: Any) -> bool:
    """Whether any number in pytrees is being traced by JAX."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(given))


def library_of(*given: Any) -> Any:
    """The library for functions of these pytrees: `jax.numpy` where any number is being traced, else `numpy`.

    Example:
        >>> library_of([1.0, 2.0]).__name__
        'numpy'
    """
    return jnp if traced(*given) else np
