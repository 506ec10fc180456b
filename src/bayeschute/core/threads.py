"""One thread for NumPy's and SciPy's linear algebra.

BLAS libraries share the sums of a matrix product out among as many threads as there are processors, and their rounding
depends on it. A fit then differs in the eighth digit, and after some hundred steps of a sampler all draws do: with two
threads in place of one a run of the default study had P = 0.9975 for 0.995. Parallel work is done by threads of our own
(`core.numerics.processors`), whose results don't depend on their number; more than one of BLAS gained nothing there.
"""

from __future__ import annotations

import numpy as np  # noqa: F401  both bring their library, which is limited once it is there
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_limits

threadpool_limits(limits=1, user_api="blas")
