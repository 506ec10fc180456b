from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.equation_error import fit
from bayeschute.regression.stacked import stack_components, stack_records


def test_stacks_keep_series_apart():
    rng = np.random.default_rng(7)
    one = stack_components(rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 2)))
    two = stack_components(rng.normal(size=(4, 2, 3)), rng.normal(size=(4, 2)))
    both = stack_records([one, two, (rng.normal(size=(6, 3)), rng.normal(size=6))])
    assert both.blocks.tolist() == [0] * 5 + [1] * 5 + [2] * 4 + [3] * 4 + [4] * 6
    assert both.groups.tolist() == [0] * 10 + [1] * 8 + [2] * 6
    assert both.components.tolist() == [0] * 5 + [1] * 5 + [0] * 4 + [1] * 4 + [0] * 6
    np.testing.assert_array_equal(both.X[:10], one.X)
    f = fit(both.X, both.z, blocks=both.blocks, groups=both.groups)
    assert len(f.noise.series) == 3 and len(f.noise.series[0].rows) == 2
    for bad in ([], [one, (np.ones((3, 2)), np.ones(3))], [(np.ones(3), np.ones(3))]):
        with pytest.raises(InputError):
            stack_records(bad)
    with pytest.raises(InputError):
        stack_components(np.ones((5, 2, 3)), np.ones((5, 3)))
