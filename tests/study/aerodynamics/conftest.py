"""What tests of aerodynamics share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.study.aerodynamics.knowledge_tables import NAMES, TRUTH

from bayeschute.likelihood.priors import Prior, correlated
from bayeschute.study.load import load_study
from bayeschute.study.templates import template


@pytest.fixture(scope="module")
def study():
    return load_study(Path(template("virtual.toml")))


@pytest.fixture
def priors():
    law = np.diag([0.1, 0.5, 0.1, 0.2, 0.3]) ** 2
    law[0, 1] = law[1, 0] = -0.03
    return correlated([Prior(n, 0.0, 1.0, False, "1", "test") for n in NAMES], TRUTH, law)
