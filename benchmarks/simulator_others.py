"""The same flight by others: C built here, diffrax and SciPy with error control."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Run = Callable[[], Array]
SOURCE = Path(__file__).with_name("cluster.c")
TERMS = ("1", "alpha^2"), ("e", "e*alpha^2", "rate", "repulsion(0.8)")
PARAMETERS = (
    *(f"axial[{term}]" for term in TERMS[0]),
    *(f"transverse[{term}]" for term in TERMS[1]),
    "riser_stiffness",
    "riser_damping",
    "enclosed_air_factor",
)
COMMON = "-O3 -march=native -std=gnu11 -fopenmp-simd -fno-math-errno -shared -fPIC"
OPTIONS = ("", "-fno-trapping-math", "-ffast-math", "-ffast-math -mprefer-vector-width=512")
TOLERANCES = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 1e-7, 1e-8)
STEPS = (1, 2, 3, 4, 5, 6, 8, 12, 16)
SCIPY = ("RK45", "DOP853", "LSODA")


def compiler() -> str | None:
    """The C compiler of this machine, if it has one."""
    return shutil.which("gcc") or shutil.which("cc")


def compiler_version() -> str | None:
    """What the C compiler calls itself."""
    cc = compiler()
    told = subprocess.run([cc, "--version"], capture_output=True, text=True, check=False).stdout if cc else ""
    return told.partition("\n")[0] or None


def _built(options: str, lanes: int) -> ctypes.CDLL | None:
    """The C program, or None where the compiler doesn't know the options."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "cluster.so"
        flags = [*COMMON.split(), *options.split(), f"-DLANES={lanes}"]
        command = [str(compiler()), *flags, str(SOURCE), "-o", str(out), "-lm"]
        done = subprocess.run(command, capture_output=True, check=False)
        return ctypes.CDLL(str(out)) if done.returncode == 0 else None


def c_programs(lanes: int) -> Iterator[tuple[str, Callable[..., Array]]]:
    """Options and simulation of every build: ``(model, theta (P, B), first (X, B), error (T, A, B)) -> (T, X, B)``.

    B is a multiple of `lanes`. Nothing where there is no compiler.
    """
    for options in OPTIONS if compiler() else ():
        program = _built(options, lanes)
        if program is not None:
            function = program.simulate
            function.argtypes = [ctypes.c_void_p] * 5 + [ctypes.c_long] * 2 + [ctypes.c_double, ctypes.c_long]
            yield f"{COMMON.split(' -std')[0]} {options}".strip(), _c_simulation(function, lanes)


def _c_simulation(function: Any, lanes: int) -> Callable[..., Array]:
    def simulate(model: Any, theta: Array, first: Array, error: Array) -> Array:
        vehicle, given, record = _c_numbers(model, theta)
        samples, _, batch = error.shape
        states = np.empty((samples, first.shape[0], batch))
        states[0] = first
        for lane in range(0, batch, lanes):
            parameters, disturbances, out = (a.ctypes.data + 8 * lane for a in (given, error, states))
            at = vehicle.ctypes.data, parameters, record.ctypes.data, disturbances, out
            function(*at, samples, batch, float(model.dt), model.stepping.substeps)
        return states

    return simulate


def c_rate(model: Any, theta: Array, error: Array) -> Callable[[float, Array], Array] | None:
    """Rate of the state at a time in C, for theta (P,) and error (T, A); None where there is no compiler."""
    program = _built(OPTIONS[0], 1) if compiler() else None
    if program is None:
        return None
    function, numbers = program.rate_at, (*_c_numbers(model, theta), np.ascontiguousarray(error))
    function.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_long] + [ctypes.c_double] * 2 + [ctypes.c_void_p] * 2
    places, size, dt = [a.ctypes.data for a in numbers], error.shape[0], float(model.dt)

    def rate(t: float, x: Array) -> Array:
        x, out = np.ascontiguousarray(x), np.empty_like(x)
        function(*places, size, dt, t, x.ctypes.data, out.ctypes.data)
        return out

    rate.keeps = numbers  # type: ignore[attr-defined]  # the addresses are theirs
    return rate


def _c_numbers(model: Any, theta: Array) -> tuple[Array, Array, Array]:
    """Vehicle, parameters and record as the C program reads them."""
    if (model.structure.axial, model.structure.transverse) != TERMS or model.names != PARAMETERS:
        raise ValueError("the C program has other terms and parameters")
    given = np.array(theta, dtype=float)
    given[6:9] = np.exp(given[6:9])
    return _vehicle(model.base), given, _record(model.record)


def _vehicle(base: Any) -> Array:
    c, k, r = base.capsule, base.canopies, base.risers
    if any(a is not None for a in (c.table, c.yaw_damping, c.pitch_rate_damping, c.yaw_rate_damping, c.products)):
        raise ValueError("the C program has the plain capsule alone")
    vectors = [v for vector in (c.inertia, c.attach_b, c.reference_centre_b) for v in (vector.x, vector.y, vector.z)]
    capsule = (c.area, c.length, c.axial_force, c.normal_force_slope, c.moment_slope, c.roll_damping, c.pitch_damping)
    canopies = (k.area, k.length, k.speed, k.dry_mass, k.enclosed_volume)
    return np.array([c.mass, *vectors, *capsule, *canopies, r.length, r.engagement, base.gravity], dtype=float)


def _record(record: Any) -> Array:
    parts = np.asarray(record.wind), np.asarray(record.density)[:, None], np.asarray(record.axial_factor)
    return np.ascontiguousarray(np.concatenate(parts, axis=1), dtype=float)


def _rate(model: Any, theta: Array, error: Array) -> Callable[[Any, Any], jax.Array]:
    """Rate of the state at a time."""
    inputs, drift = jax.tree.map(jnp.asarray, model.inputs()), jnp.asarray(error)
    numbers, last = model.numbers(jnp.asarray(theta)), error.shape[0] - 2

    def rate(t: Any, x: Any) -> jax.Array:
        at = jnp.clip(jnp.floor(t / model.dt).astype(int), 0, last)
        now, then = (jax.tree.map(lambda a, k=k: a[at + k], inputs) for k in (0, 1))
        return model.rate(x, numbers, now, then, drift[at], drift[at + 1], t / model.dt - at)

    return rate


def diffrax_runs(
    model: Any, theta: Array, first: Array, error: Array, good: Callable[[Array], bool]
) -> Iterator[tuple[str, Run]]:
    """Simulations by diffrax's Tsit5, with error control and in equal steps, each as loose as is good enough.

    Raises:
        ModuleNotFoundError: If diffrax isn't installed.
    """
    if importlib.util.find_spec("diffrax") is None:
        raise ModuleNotFoundError("diffrax")
    import diffrax

    dt = float(model.dt)
    rate, times = _rate(model, theta, error), jnp.arange(error.shape[0]) * dt
    term = diffrax.ODETerm(lambda t, x, args: rate(t, x))

    def solve(x: jax.Array, step: jax.Array, control: Any) -> jax.Array:
        way = {"saveat": diffrax.SaveAt(ts=times), "adjoint": diffrax.ForwardMode(), "max_steps": 200_000}
        ends = times[0], times[-1], step
        way |= {"stepsize_controller": control, "throw": False}
        return diffrax.diffeqsolve(term, diffrax.Tsit5(), *ends, x, **way).ys

    @jax.jit
    def controlled(x: jax.Array, tolerance: jax.Array) -> jax.Array:
        return solve(x, 0.01, diffrax.PIDController(rtol=tolerance, atol=tolerance))

    equal = jax.jit(lambda x, steps: solve(x, dt / steps, diffrax.ConstantStepSize()))
    x = jnp.asarray(first)
    yield _loosest(lambda tolerance: np.asarray(controlled(x, tolerance)), TOLERANCES, "diffrax Tsit5, tolerance", good)
    yield _loosest(lambda steps: np.asarray(equal(x, steps)), STEPS, "diffrax Tsit5, steps per sample", good)


def scipy_runs(
    model: Any, theta: Array, first: Array, error: Array, good: Callable[[Array], bool]
) -> Iterator[tuple[bool, str, Run]]:
    """Simulations by SciPy's `solve_ivp` about the rate, as loose as is good enough.

    First about the rate compiled by JAX, most of whose time is that of a call; then, marked True, about the rate in C.
    """
    from scipy.integrate import solve_ivp

    compiled, by_c = jax.jit(_rate(model, theta, error)), c_rate(model, theta, error)
    times = np.arange(error.shape[0]) * float(model.dt)

    def solve(rate: Any, method: str, tolerance: float) -> Array:
        given = first, method, times
        return solve_ivp(rate, times[[0, -1]], *given, rtol=tolerance, atol=tolerance).y.T

    for named, rate in (("", lambda t, x: np.asarray(compiled(t, x))), (" about the rate in C", by_c)):
        for method in SCIPY if rate else ():
            name = f"SciPy {method}{named}, tolerance"
            yield bool(named), *_loosest(partial(solve, rate, method), TOLERANCES, name, good)


def _loosest(
    solve: Callable[[Any], Array], settings: Sequence[float], name: str, good: Callable[[Array], bool]
) -> tuple[str, Run]:
    for setting in settings:
        if good(solve(setting)):
            return f"{name} {setting:g}", partial(solve, setting)
    raise RuntimeError(f"{name}: none is accurate enough")
