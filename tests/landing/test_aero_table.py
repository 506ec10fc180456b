"""Tables of coefficients by draw against the sums of their terms."""

from __future__ import annotations

import numpy as np

from bayeschute.landing.aero_table import COLUMNS, aero_table


def test_coefficients_are_the_sums_of_their_terms(plan):
    one = plan.models[0]
    table = aero_table(one, first=5, angles=np.deg2rad([0.0, 10.0, 20.0]))
    assert list(table.columns) == list(COLUMNS) and len(table) == 3 * len(one.theta)
    assert table["draw"].min() == 5 and table["draw"].max() == 4 + len(one.theta)
    by_name = dict(zip(one.names, one.theta.T, strict=True))
    alpha = np.deg2rad(20.0)
    rows = table[table["alpha_T_deg"].round(6) == 20.0]
    np.testing.assert_allclose(rows["C_A_1"], by_name["axial[1]"] + by_name["axial[alpha^2]"] * alpha**2)
    normal = (by_name["transverse[e]"] + by_name["transverse[e*alpha^2]"] * alpha**2) * np.sin(alpha)
    np.testing.assert_allclose(np.abs(rows["C_N_1"]), np.abs(normal), rtol=1e-9)
    assert (rows["C_N_1"] > 0.0).all()  # restores at twenty degrees
    np.testing.assert_allclose(rows["C_N_rate_1"], by_name["transverse[rate]"] * np.cos(alpha), rtol=1e-9)
