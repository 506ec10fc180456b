from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.series import time_series


def test_layout_faults():
    used = np.ones(10, dtype=bool)
    with pytest.raises(InputError, match="one length"):
        time_series(used, blocks=[0] * 4 + [1] * 6, groups=[0] * 10)
    with pytest.raises(InputError, match="one group"):
        time_series(used, blocks=[0] * 10, groups=[0] * 5 + [1] * 5)
    with pytest.raises(InputError, match="labels"):
        time_series(used, blocks=[0] * 9)
    for time in (np.zeros(10), np.arange(10.0)[::-1], np.r_[np.arange(9.0), np.nan], np.arange(10.0) ** 1.5):
        with pytest.raises(InputError):
            time_series(used, time=time)
    with pytest.raises(InputError, match="almost all gap"):
        time_series(used, time=np.r_[np.arange(9.0), 1e8])
    unequal = time_series(
        used, blocks=[0] * 4 + [1] * 6, groups=[0] * 10, time=np.r_[np.arange(2.0, 6), np.arange(6.0)]
    )
    assert unequal[0].length == 6 and unequal[0].places[0].tolist() == [2, 3, 4, 5]
