"""From planar records to the dumbbell's data, and the published coefficients back from a clean swing."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.aero.published import load_published
from bayeschute.core.errors import InputError
from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.assess import output_error
from bayeschute.posterior.joint_mode import fit
from bayeschute.reduced.dumbbell import Dumbbell
from bayeschute.reduced.dumbbell_data import GUSTS, STILL, dumbbell_data
from bayeschute.reduced.published_models import planar_aero
from bayeschute.reduced.virtual_swing import SwingDrop, fly_swing

TABLE = load_published("table-7.1-2")
AERO, TRUTH = planar_aero(TABLE), TABLE.estimates()
BASE = Dumbbell(9936.0, 71.6, Canopies(981.0, 35.4, 9.75, 149.0, 3969.0))
SMALL = NoiseParameters(Noise(np.array([2e-3, 0.02]), np.full(2, 1e-6), np.ones(2)), ())


def priors(off=0.0):
    signs = (1.0, -1.0, 1.0, -1.0, 1.0)
    pairs = zip(TRUTH.items(), signs, strict=True)
    return [Prior(name, v * (1.0 + s * off), 3.0 * abs(v), False, "1", "off") for (name, v), s in pairs]


@pytest.fixture(scope="module")
def swing():
    return fly_swing(SwingDrop(40.0, 0.1, 1800.0, 0.3), BASE, AERO, 1, substeps=2)[0]


def test_data_are_the_record(swing):
    holed = swing.copy(deep=True)
    holed["swing_angle"][50:60] = np.nan
    made = dumbbell_data(holed, BASE, AERO, priors(), GUSTS, until=30.0)
    assert made.channel == (0, 1, 1) and made.latent.rows == 2 and made.model.names == tuple(TRUTH)
    gone = np.zeros((401, 3), bool)
    gone[50:60, 0] = gone[301:] = True
    assert (np.asarray(made.present) == ~gone).all()
    np.testing.assert_array_equal(made.observed[:, 1:][:301], swing["capsule_velocity"].values[:301])
    np.testing.assert_allclose(made.model.start[4:], [0.3, 0.0], atol=2e-3)
    moving = dumbbell_data(swing.assign(wind=swing["wind"] + 1.0), BASE, AERO, priors(), channels=("air_velocity",))
    np.testing.assert_allclose(moving.observed, swing["capsule_velocity"].values - 1.0)


def test_table_7_1_2_comes_back_from_a_clean_swing(swing):
    """Started 20 % off: the optimum is the truth, far within the bounds."""
    wanted, off = np.array(list(TRUTH.values())), priors(0.2)
    flight = dumbbell_data(swing, BASE, AERO, off, STILL)
    best = fit([flight], SMALL, off, np.array([p.centre for p in off]), tolerance=1e-3)
    rows = output_error.table(output_error.bounds([flight], SMALL, off, best), off)
    assert best.converged and [r.parameter for r in rows] == list(TRUTH)
    sd = np.array([r.raw_sd for r in rows])
    assert (np.abs(best.theta - wanted) < 0.1 * sd).all()
    assert (sd < 0.5 * np.abs(wanted)).all()


def test_what_does_not_fit_is_named(swing):
    with pytest.raises(InputError, match=r"no swing_angle[\s\S]*C_D|C_D[\s\S]*swing_angle"):
        dumbbell_data(swing.drop_vars("swing_angle"), BASE, AERO, priors(), channels=("C_D",))
    with pytest.raises(InputError, match="logarithm"):
        dumbbell_data(swing, BASE, AERO, [Prior("C_A0", 0.0, 0.1, True, "1", "")])
