"""Numerical settings: JAX's 64-bit precision, threads, and cache of compiled functions, and BLAS' one thread."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from pathlib import Path

import jax

from bayeschute.core import threads as threads  # BLAS

CACHE_VARIABLE = "BAYESCHUTE_CACHE"
THREADS_VARIABLE = "NPROC"
"""XLA's number of threads (xla/pjrt/utils.cc, `DefaultThreadPoolSize`), read when JAX first computes."""
MOST_MAPS = 40_000
"""Memory maps of a process beyond which `clear_compiled` acts. Linux allows 65,530 and ends a process that wants more.
A fit of the default study brings 14,000, which its replicates share; every other structure brings 9,300 and 0.3 GB."""


def compilation_cache() -> Path:
    """Folder of compiled functions: ``$BAYESCHUTE_CACHE``, or ``bayeschute`` in the user's cache folder."""
    given = os.environ.get(CACHE_VARIABLE)
    if given:
        return Path(given)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "bayeschute" / "compiled"


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def clear_compiled(most: int = MOST_MAPS) -> bool:
    """Forget JAX's compiled functions before their memory maps fill a long-lived process, and give back their memory.

    Every structure and record length needs its own functions, and each keeps dozens of maps. What is needed again
    is compiled again. Freed memory stays with the process unless glibc is asked to trim it.

    Args:
        most: Maps up to which nothing is done.

    Returns:
        Whether functions were let go. Where maps can't be counted (not Linux) they always are.
    """
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") <= most:
        return False
    jax.clear_caches()
    gc.collect()
    if sys.platform == "linux" and (trim := getattr(ctypes.CDLL(None), "malloc_trim", None)) is not None:
        trim(0)
    return True


# glibc gives threads arenas of their own, and what is freed in one stays there: 0.25 of 1.7 GB as fits of set P went.
if sys.platform == "linux" and (_mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
    _mallopt(-8, 1)  # M_ARENA_MAX

# XLA shares the sums of a matrix product out among its threads. Their rounding, and after some hundred steps of a
# sampler its draws, would then depend on how many cores a machine, or a worker, happens to have.
os.environ.setdefault(THREADS_VARIABLE, "1")
jax.config.update("jax_enable_x64", True)
if not getattr(jax.config, "jax_compilation_cache_dir", None):
    jax.config.update("jax_compilation_cache_dir", str(compilation_cache()))
    # Small functions too: most take less than half a second each.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
