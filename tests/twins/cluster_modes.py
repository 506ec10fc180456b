"""Motion of cluster modes from their coefficients: what `reduced.cluster_mode_laws` inverts."""

from __future__ import annotations

import numpy as np


def flyout_period(canopy, q_area, normal_slope, cos_trim=1.0):
    """Period of the flyout [s] from the total slope of C_N [1/rad] (6.3.2-8, linearised about a trim angle)."""
    stiffness = q_area * normal_slope - canopy.weight * cos_trim
    return 2.0 * np.pi * np.sqrt(canopy.mass * canopy.length / stiffness)


def maypole_turning(canopy, q_area, radius, normal):
    """Rate of turn of a maypole [rad/s] from its radius [m] and (C_N)_tot (6.3.2-23)."""
    sine = radius / canopy.length
    return np.sqrt((q_area * normal - canopy.weight * sine) / (canopy.mass * radius * np.sqrt(1.0 - sine**2)))


def breathing_rate(x, cluster, stiffness, damping, axial_slope):
    """Rate of eta, eta' and the descent rate w [m/s], states (3,) (6.3.2-27..29, corrected)."""
    eta, eta_rate, w = x
    drag = (1.0 + axial_slope / cluster.axial * eta) * w * abs(w) / cluster.speed**2
    return [eta_rate, -damping * eta_rate - stiffness * eta, cluster.weight / cluster.mass * (1.0 - drag)]
