"""Equation error and output error in the frequency domain (Klein and Morelli 2006, chapter 7; report, R-8).

Data are finite Fourier transforms at M frequencies. The covariance counts real degrees of freedom: M complex residuals
are 2 M real ones where the frequencies are harmonics of the record; frequencies closer than 1/T are redundant, and the
covariance is scaled up accordingly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from bayeschute.core.errors import Fault, InputError
from bayeschute.swing.fourier import finite_transform

_SMALL_STEP = 0.01  # converged: every step below this share of a standard error
_SMALLEST_STEP = 1e-9  # or below this share of the parameter's size
_DIFFERENCE = 1e-4  # step of numerical derivatives over the scale of a parameter


@dataclass(frozen=True)
class FrequencyFit:
    """Estimates from transforms.

    Attributes:
        names: Parameters.
        estimate: (p,).
        covariance: (p, p).
        se: Standard errors (p,).
        noise: Covariance of the residuals at a frequency, by output (n, n), complex.
        residual: Measured minus modelled transforms (M, n).
        frequency: (M,) [Hz].
        repeats: Redundancy of the frequencies, 1 for harmonics.
        iterations: Of Gauss-Newton; 1 where the problem is linear.
        converged: Whether the last step was small.
    """

    names: tuple[str, ...]
    estimate: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    se: Float[np.ndarray, " p"]
    noise: Complex[np.ndarray, "n n"]
    residual: Complex[np.ndarray, "M n"]
    frequency: Float[np.ndarray, " M"]
    repeats: float
    iterations: int = 1
    converged: bool = True

    def value(self, name: str) -> float:
        """Estimate of a parameter."""
        return float(self.estimate[self.names.index(name)])

    def error(self, name: str) -> float:
        """Standard error of a parameter."""
        return float(self.se[self.names.index(name)])


def _repeats(frequency: np.ndarray, duration: float) -> float:
    """Frequencies over independent frequencies."""
    if frequency.size < 2:
        return 1.0
    return float(max(1.0, 1.0 / (np.median(np.diff(frequency)) * duration)))


def frequency_least_squares(
    X: Complex[np.ndarray, "M p"],
    z: Complex[np.ndarray, " M"],
    names: Sequence[str],
    frequency: Float[np.ndarray, " M"],
    duration: float,
) -> FrequencyFit:
    """Equation error: real parameters of a complex linear model, ``Re(X^H X)^-1 Re(X^H z)``.

    Noise of the regressors pulls the estimates towards zero, as in the time domain; a band about the motion keeps most
    of it out.

    Args:
        X: Transforms of the regressors.
        z: Transform of the response.
        names: Name of each regressor.
        frequency: Rising [Hz].
        duration: Length of the record [s].

    Returns:
        The fit.

    Raises:
        InputError: For more parameters than data, values that are not finite, or columns that depend on each other.
    """
    X, z = np.asarray(X, dtype=np.complex128), np.asarray(z, dtype=np.complex128)
    M, p = X.shape
    if 2 * M <= p:
        got = f"{M} frequencies for {p} parameters"
        raise InputError(Fault("frequency domain", got, f"more than {p // 2}", "Widen the band."))
    if not (np.isfinite(X).all() and np.isfinite(z).all()):
        raise InputError(Fault("frequency domain", "transforms that are not finite", "finite numbers"))
    A, y = np.concatenate([X.real, X.imag]), np.concatenate([z.real, z.imag])
    scale = np.linalg.norm(A, axis=0)
    if (scale == 0.0).any() or np.linalg.cond(A / np.where(scale > 0.0, scale, 1.0)) > 1e10:
        raise InputError(Fault("frequency domain", "columns that depend on each other", "independent regressors"))
    estimate = np.linalg.lstsq(A / scale, y, rcond=None)[0] / scale
    residual = z - X @ estimate
    repeats = _repeats(np.asarray(frequency), duration)
    independent = max(2.0 * M / repeats - p, 1.0)
    variance = float(np.sum(np.abs(residual) ** 2)) / repeats / independent  # of a real or imaginary part
    covariance = variance * repeats * np.linalg.inv(A.T @ A)
    return FrequencyFit(
        tuple(names), estimate, covariance, np.sqrt(np.diag(covariance)), np.array([[2.0 * variance + 0.0j]]),
        residual[:, None], np.asarray(frequency), repeats,
    )  # fmt: skip


def frequency_output_error(
    simulate: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, "N n"]],
    start: Float[np.ndarray, " p"],
    measured: Float[np.ndarray, "N n"],
    dt: float,
    frequency: Float[np.ndarray, " M"],
    names: Sequence[str],
    scale: Float[np.ndarray, " p"] | None = None,
    max_iterations: int = 50,
) -> FrequencyFit:
    """Output error: maximum likelihood of the transforms of simulated outputs, noise covariance S estimated.

    The model is simulated in time, from initial conditions among its parameters, then transformed as the data are; so
    end effects cancel and the model need not be linear. Gauss-Newton with halved steps on ``M ln|S|``; information
    ``2 Re sum D^H S^-1 D``, D the sensitivities.

    Args:
        simulate: Outputs along time for parameters.
        start: Where to start.
        measured: Outputs as measured.
        dt: Sample interval [s].
        frequency: [Hz], rising.
        names: Name of each parameter.
        scale: Size of each parameter, for numerical derivatives; the start's own where none is given.
        max_iterations: Most steps.

    Returns:
        The fit; `converged` says whether it may be used.

    Raises:
        InputError: For more parameters than data, or a start whose simulation is not finite.
    """
    measured = np.asarray(measured, dtype=np.float64).reshape(len(measured), -1)
    frequency, theta = np.asarray(frequency, dtype=np.float64), np.asarray(start, dtype=np.float64).copy()
    size = np.maximum(np.abs(theta), 1e-3) if scale is None else np.asarray(scale, dtype=np.float64)
    data = finite_transform(measured, dt, frequency)
    M, n = data.shape
    if 2 * M * n <= theta.size:
        got = f"{M} frequencies of {n} outputs for {theta.size} parameters"
        raise InputError(Fault("frequency domain", got, "more data than parameters", "Widen the band."))

    def outputs(at: np.ndarray) -> np.ndarray | None:
        made = np.asarray(simulate(at), dtype=np.float64).reshape(measured.shape)
        return finite_transform(made, dt, frequency) if np.isfinite(made).all() else None

    model = outputs(theta)
    if model is None:
        raise InputError(Fault("frequency domain", "a start whose simulation is not finite", "a start that flies"))
    theta, model, iteration, converged = _descend(outputs, data, theta, model, size, max_iterations)
    residual = data - model
    repeats = _repeats(frequency, (measured.shape[0] - 1) * dt)
    noise = _noise(residual) * (2 * M * n / max(2 * M * n - theta.size * repeats, 1.0))
    information, _ = _normal(_sensitivity(outputs, theta, size), residual, noise)
    covariance = np.linalg.pinv(information) * repeats
    return FrequencyFit(
        tuple(names), theta, covariance, np.sqrt(np.diag(covariance)), noise, residual, frequency, repeats,
        iteration, converged,
    )  # fmt: skip


def _descend(
    outputs: Callable[[np.ndarray], np.ndarray | None],
    data: np.ndarray,
    theta: np.ndarray,
    model: np.ndarray,
    size: np.ndarray,
    max_iterations: int,
) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Gauss-Newton: parameters, their model, steps taken, whether the last one was small."""
    for iteration in range(1, max_iterations + 1):
        residual = data - model
        noise = _noise(residual)
        information, gradient = _normal(_sensitivity(outputs, theta, size), residual, noise)
        step = np.linalg.lstsq(information, gradient, rcond=None)[0]
        spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(information))))
        converged = bool(np.all(np.abs(step) <= np.maximum(_SMALL_STEP * spread, _SMALLEST_STEP * size)))
        moved = _search(outputs, data, theta, step, np.linalg.slogdet(noise)[1])
        if moved is not None:
            theta, model = moved
        if converged or moved is None:
            return theta, model, iteration, converged
    return theta, model, max_iterations, False


def _noise(residual: np.ndarray) -> np.ndarray:
    """Covariance of the residuals by output, with a floor so that a perfect fit stays finite."""
    S = residual.T @ residual.conj() / residual.shape[0]
    floor = 1e-24 * max(float(np.trace(S).real), np.finfo(float).tiny)
    return np.asarray(S + floor * np.eye(S.shape[0]))


def _sensitivity(outputs: Callable[[np.ndarray], np.ndarray | None], theta: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Central differences (M, n, p); refused where the model can't be simulated nearby."""
    columns = []
    for j in range(theta.size):
        step = np.zeros_like(theta)
        step[j] = _DIFFERENCE * size[j]
        ahead, behind = outputs(theta + step), outputs(theta - step)
        if ahead is None or behind is None:
            got = f"a simulation that fails near the value of parameter {j}"
            raise InputError(Fault("frequency domain", got, "a model that is smooth there", "Start elsewhere."))
        columns.append((ahead - behind) / (2.0 * step[j]))
    return np.stack(columns, axis=-1)


def _normal(D: np.ndarray, residual: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information and gradient of the likelihood."""
    weighted = np.einsum("mnp,nk->mkp", D.conj(), np.linalg.inv(noise))
    information = 2.0 * np.einsum("mkp,mkq->pq", weighted, D).real
    return information, 2.0 * np.einsum("mkp,mk->p", weighted, residual).real


def _search(
    outputs: Callable[[np.ndarray], np.ndarray | None],
    data: np.ndarray,
    theta: np.ndarray,
    step: np.ndarray,
    best: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """The first of the halved steps that does not lower the likelihood, and its model; None if none does."""
    for halvings in range(12):
        tried = theta + step / 2.0**halvings
        model = outputs(tried)
        if model is not None and np.linalg.slogdet(_noise(data - model))[1] <= best + 1e-9 * max(abs(best), 1.0):
            return tried, model
    return None
