"""The dumbbell as two particles in Cartesian coordinates, held apart by a line force found from the constraint."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp


class Numbers:
    """Plain numbers of a dumbbell: masses [kg], weights [N], line [m], air, coefficients of Table 7.1-2."""

    def __init__(self, m_L, m_C, W_C, L, g, rho, S, n, aero, wind=(0.0, 0.0)):
        self.m_L, self.m_C, self.W_C, self.L, self.g, self.rho, self.S, self.n = m_L, m_C, W_C, L, g, rho, S, n
        self.C_A0, self.C_Aa, self.a0, self.C_Na, self.C_Nad = aero
        self.wind = np.array(wind)


def canopy_force(p, r, v_C, theta_rate):
    """Aerodynamic force on the canopies, (along, down); r runs from the canopies to the capsule."""
    b1 = r / np.hypot(*r)
    b3 = np.array([-b1[1], b1[0]])
    V = v_C - p.wind
    alpha = np.arctan2(V @ b3, V @ b1)
    C_A = p.C_A0 + 0.5 * p.C_Aa * p.a0 * (alpha**2 / p.a0**2 - 1.0)
    C_N = p.C_Na / (2.0 * p.a0**2) * (alpha**3 - p.a0**2 * alpha) + p.C_Nad * theta_rate
    return 0.5 * p.rho * (V @ V) * p.S * p.n * (-C_A * b1 - C_N * b3)


def rate(y, p):
    """Rate of (r_L, r_C, v_L, v_C); the line is as long as p.L and stays so."""
    r_L, r_C, v_L, v_C = y[0:2], y[2:4], y[4:6], y[6:8]
    r, v = r_L - r_C, v_L - v_C
    b1 = r / np.hypot(*r)
    theta_rate = (v[0] * r[1] - v[1] * r[0]) / (r @ r)
    down = np.array([0.0, 1.0])
    F_L, F_C = p.m_L * p.g * down, p.W_C * down + canopy_force(p, r, v_C, theta_rate)
    # (a_L - a_C).b1 = -v.v/L, with m_L a_L = F_L - T b1 and m_C a_C = F_C + T b1.
    T = ((F_L / p.m_L - F_C / p.m_C) @ b1 + (v @ v) / p.L) / (1.0 / p.m_L + 1.0 / p.m_C)
    return np.concatenate([v_L, v_C, (F_L - T * b1) / p.m_L, (F_C + T * b1) / p.m_C])


def cartesian(x, L):
    """Particles of a dumbbell's state (along, down, their rates, theta, theta')."""
    s, c = np.sin(x[4]), np.cos(x[4])
    r_L, v_L = x[0:2], x[2:4]
    return np.concatenate([r_L, r_L - L * np.array([s, c]), v_L, v_L - L * x[5] * np.array([c, -s])])


def fly(x0, p, time):
    """Swing angles (T,) and capsule velocities (T, 2)."""
    solved = solve_ivp(
        lambda t, y: rate(y, p), (time[0], time[-1]), cartesian(x0, p.L), "DOP853", time, rtol=1e-11, atol=1e-11
    )
    r = solved.y[0:2] - solved.y[2:4]
    return np.arctan2(r[0], r[1]), solved.y[4:6].T
