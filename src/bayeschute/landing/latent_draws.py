"""Latent disturbances of a posterior (`likelihood.disturbances`), drawn for many landings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.likelihood.disturbances import STATES, Latent

Array = NDArray[np.float64]


def without_wind(latent: Latent) -> Latent:
    """The processes but those of the wind, whose place the winds of a campaign take."""
    return latent._replace(processes=tuple((row, group) for row, group in latent.processes if row >= 3))


def latent_rows(latent: Latent, laws: Sequence[Array], dt: float, z: Array, least: int) -> Array:
    """Disturbances by time.

    Args:
        latent: The processes.
        laws: Parameters of every group (number, B), in the order of `disturbances.KINDS`.
        dt: Sample interval [s].
        z: Standard normal numbers (T, L, B), L states of all processes.
        least: Rows wanted.

    Returns:
        (T, rows, B), zero where no process acts.
    """
    made = np.zeros((len(z), max(least, latent.rows), z.shape[2]))
    drifts = [(k, row, group) for k, row, group in _places(latent) if latent.kinds[group] == "drift"]
    if drifts:
        sd = np.stack([laws[group][0] for _, _, group in drifts])
        keep = np.exp(-dt / np.stack([laws[group][1] for _, _, group in drifts]))
        fresh = sd * np.sqrt(1.0 - keep**2)
        of_z = [k for k, _, _ in drifts]
        state = sd * z[0][of_z]
        paths = np.empty((len(z), *state.shape))
        paths[0] = state
        for t in range(1, len(z)):
            state = keep * state + fresh * z[t][of_z]
            paths[t] = state
        for i, (_, row, _) in enumerate(drifts):
            made[:, row] += paths[:, i]
    for k, row, group in _places(latent):
        if latent.kinds[group] == "oscillator":
            made[:, row] += _oscillation(laws[group], dt, z[:, k : k + 2])
    return made


def _places(latent: Latent) -> list[tuple[int, int, int]]:
    """First state, row and group of every process."""
    found, k = [], 0
    for row, group in latent.processes:
        found.append((k, row, group))
        k += STATES[latent.kinds[group]]
    return found


def _oscillation(law: Array, dt: float, z: Array) -> Array:
    """A randomly driven oscillator (T, B): laws (3, B), normal numbers (T, 2, B)."""
    sd, omega, zeta = law[0], 2.0 * np.pi * law[1], law[2]
    count = law.shape[1]
    step, driven = np.empty((2, 2, count)), np.empty((2, 2, count))
    _, first, back = np.unique(law, axis=1, return_index=True, return_inverse=True)
    for i, b in enumerate(first):
        a = omega[b] * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta[b]]])
        e = scipy.linalg.expm(a * dt)
        here = np.ravel(back) == i
        step[..., here] = e[..., None]
        driven[..., here] = np.linalg.cholesky(np.eye(2) * (1.0 + 1e-13) - e @ e.T)[..., None]
    state = z[0].copy()
    made = np.empty((len(z), count))
    made[0] = state[0]
    for t in range(1, len(z)):
        x, y = state
        state = np.stack(
            [
                step[0, 0] * x + step[0, 1] * y + driven[0, 0] * z[t, 0],
                step[1, 0] * x + step[1, 1] * y + driven[1, 0] * z[t, 0] + driven[1, 1] * z[t, 1],
            ]
        )
        made[t] = state[0]
    return np.asarray(sd * made)
