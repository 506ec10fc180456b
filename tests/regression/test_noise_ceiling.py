from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.noise_ceiling import noise_ceiling
from bayeschute.regression.orthogonal import select


def test_rules():
    z = np.array([1.0, 2.0, 4.0])
    X = np.eye(3)
    assert select(X, z).ceiling.value == pytest.approx(np.var(z))
    assert select(X, z, sigma_max2=0.3).ceiling[:2] == (0.3, "fixed")
    assert select(X, z, noise_variance=0.01).ceiling.value == pytest.approx(0.25)
    assert select(X, z, noise_variance=0.01, rule="smoothing").ceiling.value == pytest.approx(0.01)
    assert noise_ceiling("default", variance=2.0).noise_variance == pytest.approx(2.0 / 25)
    for bad in (
        {"rule": "smoothing"},
        {"rule": "other"},
        {"rule": None, "sigma_max2": 0.0},
        {"rule": None, "noise_variance": np.nan},
    ):
        with pytest.raises(InputError):
            noise_ceiling(**bad)
    with pytest.raises(InputError, match="variance of z"):
        select(X, np.ones(3))
