"""The one place that sets JAX's precision (64 bits) and keeps its compiled functions between runs."""

from __future__ import annotations

import os
from pathlib import Path

import jax

CACHE_VARIABLE = "BAYESCHUTE_CACHE"


def compilation_cache() -> Path:
    """Folder of compiled functions: ``$BAYESCHUTE_CACHE``, or ``bayeschute`` in the user's cache folder."""
    given = os.environ.get(CACHE_VARIABLE)
    if given:
        return Path(given)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "bayeschute" / "compiled"


jax.config.update("jax_enable_x64", True)
if not getattr(jax.config, "jax_compilation_cache_dir", None):
    jax.config.update("jax_compilation_cache_dir", str(compilation_cache()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
