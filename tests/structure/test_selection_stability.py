from __future__ import annotations

import numpy as np
import pytest

from bayeschute.regression.orthogonal import select
from bayeschute.structure.selection_stability import selection_frequency


@pytest.mark.parametrize("kind", ["pairs", "residual"])
def test_selection_frequency(kind):
    rng = np.random.default_rng(9)
    X = np.column_stack([np.ones(400), rng.normal(size=(400, 7))])
    z = 3.0 + 2.0 * X[:, 2] + 0.25 * X[:, 5] + rng.normal(size=400)
    base = select(X, z, noise_variance=1.0)
    result = selection_frequency(X, z, base, rng=rng, replicates=60, kind=kind, sigma_max2=[25.0, 1.0])
    assert result.frequency[[0, 2]].tolist() == [1.0, 1.0] and result.frequency[[1, 3, 4, 6, 7]].max() < 0.2
    assert sum(share for _, share in result.structures) == pytest.approx(1.0)
    assert {"x1", "x3"} <= set(result.structures[0][0])
    np.testing.assert_allclose(result.by_sigma_max[0], result.frequency)
    assert (result.by_sigma_max[1] >= result.by_sigma_max[0]).all()
    # the weak sixth term is no part of the model that "residual" redraws from
    assert base.terms == ("x1", "x3") and (result.by_sigma_max[1, 5] > 0.9) == (kind == "pairs")
