"""Linear algebra is rounded alike whatever the number of processors."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

LOADED = """
import json
import threadpoolctl
import {module}
print(json.dumps([one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"]))
"""


@pytest.mark.parametrize("module", ["bayeschute.regression", "bayeschute.core.numerics"])
def test_whatever_computes_first_limits_blas_to_one_thread(module):
    """Even where the environment asks for more."""
    given = {k: v for k, v in os.environ.items() if k != "OMP_NUM_THREADS"} | {"OPENBLAS_NUM_THREADS": "2"}
    found = subprocess.run(
        [sys.executable, "-c", LOADED.format(module=module)], env=given, capture_output=True, text=True, check=True
    )
    threads = json.loads(found.stdout)
    assert threads and set(threads) == {1}
