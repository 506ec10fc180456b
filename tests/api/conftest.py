"""The two made-up sondes through the door: study, fit of one, its posterior."""

from __future__ import annotations

import pytest

import bayeschute as bc


@pytest.fixture(scope="session")
def sondes(descents):
    return bc.Study.load(descents.study)


@pytest.fixture(scope="session")
def fitted(sondes):
    return bc.fit(sondes.flights["low"])


@pytest.fixture(scope="session")
def posterior(fitted):
    return bc.sample(fitted, draws=200, chains=2, warmup=50, seed=4)
