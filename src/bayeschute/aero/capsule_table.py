"""Aerodynamics of a capsule by tables of total angle of attack and aerodynamic roll (report 6.3.3-10..12), smooth.

A coefficient of a smooth body is a Fourier series in the roll whose m-th amplitude begins at the axis with a power of
the sine: C(alpha, phi) = sum over m of sin(alpha)^p [a_m(alpha) cos(m phi) + b_m(alpha) sin(m phi)], p = 0 for m = 0,
1 for odd m, 2 for even m. The series interpolates every roll angle of the table; a_m and b_m are cubic splines through
the table's angles of attack, with zero slope on the axis. Written with the direction of the airflow in body axes,
nothing depends on the roll angle itself, which is undefined on the axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.aero.capsule_grid import COEFFICIENTS, grid_faults, is_pole
from bayeschute.core.errors import InputError
from bayeschute.core.vectors import Component, Vec3

Array = NDArray[np.float64]
Harmonic = tuple[int, int, bool]  # place in COEFFICIENTS, m, whether it is the sine's

_LEAST_SINE = 1e-12  # keeps the angle's gradient finite on the axis
_CORE = 1e-3  # [rad] about the axis where harmonics from the third on fade out: their direction is undefined there


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CapsuleTable:
    """Splines of the amplitudes of H harmonics over K angles.

    Attributes:
        angle: Total angles of attack (K,) [rad]; constant extrapolation.
        value: Amplitudes at the first angle (H,).
        slope: Their slopes there (H,) [1/rad].
        curvature: Half their second derivatives there (H,) [1/rad^2].
        jump: Sixth parts of the third derivatives' jumps at all angles but the last (K - 1, H) [1/rad^3].
        harmonics: Harmonic of each amplitude.
    """

    angle: Component
    value: Component
    slope: Component
    curvature: Component
    jump: Component
    harmonics: tuple[Harmonic, ...] = field(metadata={"static": True})


def capsule_table(angle: Array, roll: Array, coefficients: Mapping[str, Array]) -> CapsuleTable:
    """Splines through a table.

    Args:
        angle: Total angles of attack (K,), increasing within 0 and pi [rad].
        roll: Aerodynamic rolls (R,): a whole turn in even steps from 0, without its end; or 0 alone, for a body of
            revolution [rad].
        coefficients: Of `COEFFICIENTS`, (K, R) each, in body axes; those that are missing are zero.

    Returns:
        The splines.

    Raises:
        InputError: With every fault of the table.
    """
    faults = grid_faults(angle, roll, coefficients, "capsule table")
    if faults:
        raise InputError(faults)
    full = {name: np.asarray(coefficients.get(name, np.zeros((len(angle), len(roll)))), float) for name in COEFFICIENTS}
    series = _of_revolution(full) if len(roll) == 1 else _fourier(full, len(roll))
    rows = {key: amplitude for key, amplitude in series.items() if np.any(amplitude != 0.0)}
    splines = [_spline(np.asarray(angle, float), m, amplitude) for (_, m, _), amplitude in rows.items()]
    value, slope, curvature, jump = (np.array(part) for part in zip(*splines, strict=True))
    return CapsuleTable(np.asarray(angle, float), value, slope, curvature, jump.T.copy(), tuple(rows))


def _of_revolution(full: Mapping[str, Array]) -> dict[Harmonic, Array]:
    """Amplitudes of a body of revolution from its coefficients at roll 0; lateral ones rotate with the roll angle."""
    c = {name: values[:, 0] for name, values in full.items()}
    at = {name: i for i, name in enumerate(COEFFICIENTS)}
    return {
        (at["C_A"], 0, False): c["C_A"],
        (at["C_l"], 0, False): c["C_l"],
        (at["C_Y"], 1, False): c["C_Y"],
        (at["C_Y"], 1, True): -c["C_N"],
        (at["C_N"], 1, False): c["C_N"],
        (at["C_N"], 1, True): c["C_Y"],
        (at["C_m"], 1, False): c["C_m"],
        (at["C_m"], 1, True): c["C_n"],
        (at["C_n"], 1, False): c["C_n"],
        (at["C_n"], 1, True): -c["C_m"],
    }


def _fourier(full: Mapping[str, Array], rolls: int) -> dict[Harmonic, Array]:
    """Amplitudes of the trigonometric interpolation through equidistant roll angles, without rounding errors."""
    series: dict[Harmonic, Array] = {}
    for place, values in enumerate(full.values()):
        transform = np.fft.rfft(values, axis=1) / rolls
        noise = 1e-14 * np.max(np.abs(values), initial=0.0)
        for m in range(transform.shape[1]):
            both = 1.0 if m == 0 or 2 * m == rolls else 2.0
            for sine, part in ((False, transform[:, m].real), (True, -transform[:, m].imag)):
                series[place, m, sine] = np.where(np.abs(part) > noise, both * part, 0.0)
    return series


def _power(sine_squared: Component, m: int) -> Component:
    """The sine's power that the m-th amplitude begins with, p of the head, over its m-th."""
    return 1.0 if m < 3 else (sine_squared + _CORE**2) ** -((m - 1) // 2)


def _spline(angle: Array, m: int, amplitude: Array) -> tuple[Array, Array, Array, Array]:
    """Value, slope, half curvature at the first angle and the jumps of an amplitude over its power of the sine."""
    from scipy.interpolate import CubicSpline

    poles = is_pole(angle)
    values = amplitude.copy()
    if m > 0:
        inside = ~poles
        sine = np.sin(angle[inside])
        values[inside] /= sine**m * _power(sine**2, m)
        for end, near in ((0, (1, 2)), (-1, (-2, -3))):
            if poles[end]:  # an even parabola through the next two angles
                b, c = ((angle[i] - angle[end]) ** 2 for i in near)
                values[end] = (c * values[near[0]] - b * values[near[1]]) / (c - b)
    ends = tuple((1, 0.0) if poles[end] else (2, 0.0) for end in (0, -1))
    cubic, square, linear, constant = CubicSpline(angle, values, bc_type=ends).c
    return constant[0], linear[0], square[0], np.diff(cubic, prepend=0.0)


def table_coefficients(table: CapsuleTable, along: Vec3) -> tuple[Component, ...]:
    """The six coefficients of `COEFFICIENTS` in an airflow, shape of the components of `along`.

    Args:
        table: The table.
        along: Unit vector of the velocity relative to the air, body axes.
    """
    sine_squared = along.y * along.y + along.z * along.z
    alpha = jnp.arctan2(jnp.sqrt(sine_squared + _LEAST_SINE**2), along.x)
    tail = (1,) * jnp.ndim(alpha)
    nodes = jnp.reshape(table.angle, (-1, *tail))
    t = jnp.clip(alpha, nodes[0], nodes[-1]) - nodes[0]
    powers = jnp.maximum(t - (nodes[:-1] - nodes[0]), 0.0) ** 3
    turns = _turns(along, sine_squared, max(m for _, m, _ in table.harmonics))
    found: list[Component] = [jnp.zeros_like(alpha) for _ in COEFFICIENTS]
    for h, (place, m, sine) in enumerate(table.harmonics):
        spline = table.value[h] + t * (table.slope[h] + t * table.curvature[h])
        spline = spline + jnp.sum(jnp.reshape(table.jump[:, h], (-1, *tail)) * powers, axis=0)
        found[place] = found[place] + spline * turns[m][sine]
    return tuple(found)


def _turns(along: Vec3, sine_squared: Component, last: int) -> list[tuple[Component, Component]]:
    """``sin^p cos(m phi)`` and ``sin^p sin(m phi)`` for m up to `last`, as powers of z + i y of the direction."""
    cosine, sine = jnp.ones_like(sine_squared), jnp.zeros_like(sine_squared)
    turns = [(cosine, sine)]
    for m in range(1, last + 1):
        cosine, sine = cosine * along.z - sine * along.y, cosine * along.y + sine * along.z
        power = _power(sine_squared, m)
        turns.append((cosine * power, sine * power))
    return turns
