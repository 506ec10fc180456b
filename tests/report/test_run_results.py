from __future__ import annotations

import numpy as np


def test_a_run_comes_back_whole(results):
    assert not results.absent
    assert results.posterior["axial[1]"].shape == (4, 250)
    assert results.prior["axial[1]"].shape == (1, 1000)
    assert list(results.predictions) == ["cdt-3-11", "cdt-3-12"]
    assert results.predictions["cdt-3-12"].attrs["role"] == "predict"
    assert list(results.flights) == ["cdt-3-11", "cdt-3-12"]
    assert set(results.risk) == {"marginals", "exceedance", "tolerance"}
    assert np.isfinite(results.predictions["cdt-3-12"]["swing_angle"].values).all()
    assert results.part("no such part") == {}
    assert results.part("seed") == {}
    assert results.table("tolerance", "run", "share") is results.risk["tolerance"]
    assert results.table("tolerance", "no such column") is None and results.table("draws") is None
