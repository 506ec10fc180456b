from __future__ import annotations

import pytest

from bayeschute.calibration.label import is_verified, label_of


@pytest.mark.parametrize(("lacking", "verified"), [((), True), (("missed rhat",), False)])
def test_a_label_is_read_as_it_was_written(lacking, verified):
    label = label_of(lacking, "120 replicate flights: all held")
    assert is_verified(label) is verified and label.startswith("verified: 120" if verified else "not verified: missed")


def test_no_label_is_no_verdict():
    assert not is_verified("") and not is_verified("verified by nobody") and is_verified("verified")
