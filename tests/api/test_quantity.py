"""Arguments of the door: a text with its unit and a number in SI are the same, and levels are of a central interval."""

from __future__ import annotations

import pytest

from bayeschute.api.quantity import central, si
from bayeschute.core.errors import InputError


def test_a_text_is_converted_and_a_number_is_taken_as_it_is():
    assert si("speed", "33 ft/s", "m/s") == pytest.approx(10.0584) and si("speed", 33, "m/s") == 33.0
    assert si("angle", "90 deg", "rad") == pytest.approx(1.5707963)


def test_another_dimension_is_refused_with_where_and_what():
    with pytest.raises(InputError) as refused:
        si("the speed", "3 kg", "m/s")
    (fault,) = refused.value.faults
    assert fault.where == "the speed" and "convertible to m/s" in str(refused.value) and refused.value.__cause__ is None


def test_as_much_lies_below_as_above():
    for level in (0.5, 0.9, 0.99):
        low, middle, high = central(level)
        assert middle == 0.5 and high - low == pytest.approx(level) and low == pytest.approx(1.0 - high)
    for none in (0.0, 1.0, 90.0, -0.1, float("nan")):
        with pytest.raises(InputError, match="between 0 and 1"):
            central(none)
