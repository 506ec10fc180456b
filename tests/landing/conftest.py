"""What tests of landings share."""

from __future__ import annotations

import pytest
from tests.landing.plans import small_plan


@pytest.fixture(scope="session")
def plan():
    return small_plan()
