"""Curves of the force coefficients by name, told without importing JAX (their evaluation: `bayeschute.aero.curves`).

| curve | over | is |
|---|---|---|
| ``C_A`` | alpha [rad] | axial force coefficient, drag positive |
| ``C_N`` | alpha [rad] | normal force coefficient, restoring positive (6.3.3-5) |
| ``C_N_rate`` | alpha [rad] | its derivative by alpha_dot l/(2 abs(V)): positive damps (6.3.1-12) |
| ``proximity`` | D_prox [1] | force coefficient away from one other canopy, at zero angle of attack (6.1-11) |
"""

from __future__ import annotations

from typing import NamedTuple

ANGLE, DISTANCE = "alpha", "D_prox"


class Along(NamedTuple):
    """What a curve is over (symbol and SI unit), and what it is, in words."""

    symbol: str
    unit: str
    words: str


CURVES = {
    "C_A": Along(ANGLE, "rad", "axial force coefficient"),
    "C_N": Along(ANGLE, "rad", "normal force coefficient, restoring positive"),
    "C_N_rate": Along(ANGLE, "rad", "dC_N / d(alpha_dot l/2V), damping positive"),
    "proximity": Along(DISTANCE, "1", "force coefficient away from the other canopy"),
}
