"""The density beside Laplace's approximation at points."""

from __future__ import annotations

import numpy as np
import pytest
from tests.fitting import minus_log_density, plain

from bayeschute.posterior.beyond_linear.comparison import compared
from bayeschute.posterior.marginal import log_density


@pytest.mark.parametrize("which", ["falling", "gusty"])
def test_what_the_polynomials_leave_is_told(which, request):
    made = request.getfixturevalue(which)
    made = made[-1] if which == "gusty" else made
    xi = np.random.default_rng(7).standard_normal((3, 1))
    exact = np.array([-minus_log_density(made, x) for x in (np.zeros(1), *xi)])
    found = []
    for one in (made, plain(made)):
        ours = np.asarray(log_density(one, np.concatenate([np.zeros((1, 1)), xi]).T))
        left = exact[1:] - exact[0] - ours[1:] + ours[0]
        np.testing.assert_allclose(compared(one, xi).errors, -left, rtol=1e-6, atol=1e-7)
        found.append(np.sqrt(np.mean(left**2)))
    assert found[0] < 0.3 * found[1] and found[1] > 0.02, found
