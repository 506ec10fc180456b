"""A ``structure.json`` with every part, from small regressions on made-up swings."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from bayeschute.regression.propagation import Propagated
from bayeschute.regression.stacked import stack_components
from bayeschute.structure.candidates import product_pool
from bayeschute.structure.search import Search, identify
from bayeschute.structure.structure_entry import entry
from bayeschute.structure.synthetic import Making, replicate
from bayeschute.structure.synthetic_entry import checks, synthetic_entry

DT = 0.1


def structure_found() -> dict[str, Any]:
    """Coefficients ``axial`` and ``C_A`` of one record, and synthetic data of two known terms."""
    rng = np.random.default_rng(0)
    t = DT * np.arange(600)
    pool = product_pool({"alpha": np.sin(0.44 * t) + 0.2 * np.sin(1.2 * t), "q": np.cos(0.3 * t)}, 2)
    X, truth = pool.matrix(), {"1": 0.9, "alpha^2": -0.4}
    z = X[:, [0, pool.names.index("alpha^2")]] @ list(truth.values()) + 0.05 * rng.normal(size=600)
    stack = stack_components(X[:, None, :], z[:, None])
    how = Search(sigma_max=3.0, replicates=12, exchange=True, first=("1",))
    found = identify(stack, pool.names, DT, how, rng, pool.indices)
    few = Propagated(0.15, 0.01, np.full(len(found.fit.names), 0.003), np.zeros(len(found.fit.names)), 8)
    told = entry(found, pool.names, how, DT, checks={"other": stack}, propagated=few)
    making = Making(10.0, 0.3, 4)
    made = {"C_A": synthetic_entry(replicate(pool, truth, making, DT, how, rng), making, X)}
    synthetic = {
        "source": "a table", "reading": "conventional", "flight": "lively", "canopy": 1, "time_constant": 0.3,
        "replicates": 4, "exchange": True, "sigma_max": 3.0, "coefficients": made, "checks": checks(made),
    }  # fmt: skip
    whole = {
        "coefficients": {"axial": told},
        "polar": {"C_A": told},
        "synthetic": synthetic,
        "sufficiency": ["So far."],
    }
    return dict(json.loads(json.dumps(whole)))
