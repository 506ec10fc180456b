"""Published sets as flown: planar coefficients, and what the polar set says of drag."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.aero.published import load_published
from bayeschute.core.errors import InputError
from bayeschute.core.units import to_si
from bayeschute.reduced.planar import PlanarAero
from bayeschute.reduced.published_models import planar_aero


def test_planar_set():
    assert planar_aero(load_published("table-7.1-2")) == PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)


def test_a_polar_set_is_refused():
    with pytest.raises(InputError, match="got a polar set; wanted a planar set"):
        planar_aero(load_published("table-7.3-1"))


def test_printed_drag_does_not_hold_the_descent_rate():
    """C_A falls with q so fast that drag does, too, above 1.05 psf: 97 % of that row restates W = 2 q S C_A."""
    c = load_published("table-7.3-1").of("C_A")
    q = np.linspace(0.8, 1.5, 71) * to_si("1 psf", "Pa")
    drag = q * (c["1"] + c["q"] * q)
    assert q[drag.argmax()] == pytest.approx(1.05 * to_si("1 psf", "Pa"), abs=0.5)
    assert (np.diff(drag)[q[1:] > 51.0] < 0.0).all()
