"""Naive twins of the selection of terms: every step solves full least-squares problems from scratch."""

from __future__ import annotations

import numpy as np


def naive_mof(X: np.ndarray, z: np.ndarray, cost: float, steps: int) -> dict[str, object]:
    """Forward choice by least squares refitted for every candidate; `cost` = f sigma_max^2/N."""
    chosen: list[int] = []
    mse = [float(np.mean(z**2))]
    for _ in range(steps):
        trials = {}
        for j in range(X.shape[1]):
            if j in chosen:
                continue
            columns = X[:, [*chosen, j]]
            if np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0), tol=1e-7) < columns.shape[1]:
                continue
            theta = np.linalg.lstsq(columns, z, rcond=None)[0]
            trials[j] = float(np.mean((z - columns @ theta) ** 2))
        if not trials:
            break
        best = min(trials, key=lambda j: trials[j])
        chosen.append(best)
        mse.append(trials[best])
    pse = [m + cost * n for n, m in enumerate(mse)]
    n = min(range(len(pse)), key=lambda k: pse[k])
    theta = np.linalg.lstsq(X[:, chosen[:n]], z, rcond=None)[0] if n else np.zeros(0)
    return {"order": chosen, "mse": mse, "pse": pse, "minimum": n, "estimate": theta}


def orthogonal_matching_pursuit(X: np.ndarray, z: np.ndarray, steps: int) -> list[int]:
    """Order of orthogonal matching pursuit: largest cosine of a whole column with the residual."""
    unit = X / np.linalg.norm(X, axis=0)
    chosen: list[int] = []
    residual = z
    for _ in range(steps):
        score = np.abs(unit.T @ residual)
        score[chosen] = -1.0
        chosen.append(int(np.argmax(score)))
        residual = z - X[:, chosen] @ np.linalg.lstsq(X[:, chosen], z, rcond=None)[0]
    return chosen


def predicted_squared_errors(X: np.ndarray, z: np.ndarray, order: list[int], cost: float) -> list[float]:
    """Predicted squared error along a given order, each row fitted from scratch."""
    out = [float(np.mean(z**2))]
    for n in range(1, len(order) + 1):
        theta = np.linalg.lstsq(X[:, order[:n]], z, rcond=None)[0]
        out.append(float(np.mean((z - X[:, order[:n]] @ theta) ** 2)) + cost * n)
    return out
