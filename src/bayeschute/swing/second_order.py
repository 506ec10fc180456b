"""The linear second-order model ``x'' + 2 b x' + omega_n^2 x = k u + c`` in both domains (report, 6.3.1-20..28; R-8).

It is the linear pendulum, forced (by wind, by a moving support) or free. In the frequency domain the equation is linear
in 2b, omega_n^2, k and in end terms, which take up how the record begins and ends: nothing has to be periodic or
windowed, and noisy end values are estimated along with the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.swing.fourier import finite_transform
from bayeschute.swing.frequency import FrequencyFit, frequency_least_squares, frequency_output_error

ENDS = ("end_rate", "end_value", "start_rate", "start_value")
JUMPS = ("jump_rate", "jump_value")


class Motion(NamedTuple):
    """Measured quantities of the motion.

    Attributes:
        angle: x (N,).
        rate: x' (N,).
    """

    angle: Float[np.ndarray, " N"]
    rate: Float[np.ndarray, " N"]


def respond(
    stiffness: float,
    two_b: float,
    start: tuple[float, float],
    acceleration: Float[np.ndarray, " N"],
    dt: float,
) -> Motion:
    """Motion from an initial state under a given acceleration, exact for one that is linear between samples.

    Args:
        stiffness: omega_n^2 [1/s^2].
        two_b: 2 b [1/s].
        start: x(0) and x'(0).
        acceleration: k u + c along time [unit of x / s^2].
        dt: Sample interval [s].

    Returns:
        Angle and rate.
    """
    from scipy.linalg import expm

    generator = np.zeros((4, 4))
    generator[0, 1] = generator[2, 3] = 1.0
    generator[1, :3] = -stiffness, -two_b, 1.0
    step = expm(generator * dt)  # state, acceleration, its slope
    (a, b), (c, d) = step[:2, :2].tolist()
    held, sloped = step[:2, 2], step[:2, 3]
    push = np.outer(acceleration[:-1], held) + np.outer(np.diff(acceleration) / dt, sloped)
    x, v = float(start[0]), float(start[1])
    out = [(x, v)]
    for p, q in push.tolist():
        x, v = a * x + b * v + p, c * x + d * v + q
        out.append((x, v))
    made = np.array(out)
    return Motion(made[:, 0], made[:, 1])


def _inputs(forcing: np.ndarray | None, samples: int) -> np.ndarray:
    """Forcings as columns (N, m)."""
    if forcing is None:
        return np.zeros((samples, 0))
    columns = np.asarray(forcing, dtype=np.float64).reshape(len(forcing), -1)
    if columns.shape[0] != samples:
        raise InputError(Fault("forcing", f"{columns.shape[0]} samples", f"{samples}, as many as the response has"))
    return columns


def _gain_names(count: int) -> tuple[str, ...]:
    return tuple("gain" if count == 1 else f"gain_{j + 1}" for j in range(count))


def second_order_equation_error(
    angle: Float[np.ndarray, " N"],
    dt: float,
    frequency: Float[np.ndarray, " M"],
    forcing: Float[np.ndarray, "N ..."] | None = None,
) -> FrequencyFit:
    """Equation error of the second-order model from a record of x alone; its noise is unknown forcing (turbulence).

    ``omega^2 x~ = 2b (i omega x~) + omega_n^2 x~ - k u~ + end terms``. A constant c only enters at zero frequency,
    which harmonics leave out; elsewhere, and for drifts, add a forcing column of ones.

    Args:
        angle: x, none missing.
        dt: Sample interval [s].
        frequency: [Hz], rising, zero left out (`bayeschute.swing.fourier.harmonics`).
        forcing: u; several columns have a gain each.

    Returns:
        Parameters ``two_b`` [1/s], ``stiffness`` [1/s^2], ``gain`` (or ``gain_1`` ...), and the end terms `ENDS`:
        x'(T) + 2b x(T), x(T), x'(0) + 2b x(0), x(0). Harmonics determine their differences over the record only,
        `JUMPS`.

    Raises:
        InputError: As `finite_transform` and `frequency_least_squares`.
    """
    angle = np.asarray(angle, dtype=np.float64)
    inputs, duration = _inputs(forcing, angle.size), (angle.size - 1) * dt
    both = finite_transform(np.column_stack([angle, inputs]), dt, frequency)
    s = 2j * np.pi * np.asarray(frequency)
    x, end = both[:, 0], np.exp(-s * duration)
    ends: tuple[str, ...] = JUMPS
    columns = [s * x, x, *(-both[:, 1:]).T, np.ones_like(s), s]
    if not np.allclose(end, 1.0, atol=1e-6):
        ends, columns = ENDS, [*columns[:-2], end, s * end, -np.ones_like(s), -s]
    names = ("two_b", "stiffness", *_gain_names(inputs.shape[1]), *ends)
    X, z = np.stack(columns, axis=1), -(s**2) * x
    return frequency_least_squares(X, z, names, frequency, duration)


def second_order_output_error(
    measured: Float[np.ndarray, "N ..."],
    dt: float,
    frequency: Float[np.ndarray, " M"],
    forcing: Float[np.ndarray, "N ..."] | None = None,
    seen: tuple[str, ...] = ("angle",),
    start: FrequencyFit | None = None,
) -> FrequencyFit:
    """Output error of the second-order model, free initial state, from angle, rate or both.

    Args:
        measured: Columns as `seen` names them, none missing.
        dt: Sample interval [s].
        frequency: [Hz], rising, zero left out.
        forcing: u; several columns have a gain each.
        seen: ``angle`` and ``rate``, in the order of the columns.
        start: Equation error to start from; made from the first column where none is given.

    Returns:
        Parameters ``two_b``, ``stiffness``, gains, ``start_value`` and ``start_rate``: x(0), x'(0).

    Raises:
        InputError: As `frequency_output_error`; for other names than these two.
    """
    measured = np.asarray(measured, dtype=np.float64).reshape(len(measured), -1)
    if not set(seen) <= {"angle", "rate"} or len(seen) != measured.shape[1]:
        raise InputError(Fault("output error, seen", f"{seen}", f"'angle' or 'rate' for {measured.shape[1]} columns"))
    inputs = _inputs(forcing, len(measured))
    first = start or second_order_equation_error(measured[:, 0], dt, frequency, forcing)
    gains = _gain_names(inputs.shape[1])
    stiffness = max(first.value("stiffness"), 1e-6)
    omega = float(np.sqrt(stiffness))

    def simulate(theta: np.ndarray) -> np.ndarray:
        pushed = inputs @ theta[2:-2] if inputs.shape[1] else np.zeros(len(inputs))
        motion = respond(theta[1], theta[0], (theta[-2], theta[-1]), pushed, dt)
        return np.column_stack([getattr(motion, name) for name in seen])

    known = np.array([first.value("two_b"), stiffness, *(first.value(g) for g in gains)])
    zero = simulate(np.concatenate([known, [0.0, 0.0]]))
    free = [simulate(np.concatenate([known, unit])) - zero for unit in np.eye(2)]
    begin = np.linalg.lstsq(np.stack([r.ravel() for r in free], axis=1), (measured - zero).ravel(), rcond=None)[0]
    amplitude = max(float(np.std(measured[:, 0])), np.finfo(float).tiny) / (omega if seen[0] == "rate" else 1.0)
    size = [omega, stiffness, *(max(abs(first.value(g)), 1e-3) for g in gains), amplitude, amplitude * omega]
    names = ("two_b", "stiffness", *gains, "start_value", "start_rate")
    return frequency_output_error(
        simulate, np.concatenate([known, begin]), measured, dt, frequency, names, np.array(size)
    )
