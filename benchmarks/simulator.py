"""How fast is the simulator? One core, one run: against C, diffrax and SciPy, and how time and memory grow.

A 90 s record of the default cluster at 10 Hz. The yardstick `cluster.c` holds the same equations, written by hand, as a
structure of arrays and as a scalar program; both are built here with several sets of options and the fastest counts.
diffrax and SciPy take the loosest tolerance at which they are as near to a tight reference as asked. SciPy is given the
rate that JAX compiled; most of its time are calls of that, so it is timed about the rate in C, too. Times are those of
the processor, the best of several in turns. What isn't installed (a C compiler, diffrax) is left out, with a word.

    python benchmarks/simulator.py [--jax-steps] [--json]
"""

from __future__ import annotations

import os
import tracemalloc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from time import process_time
from typing import Any

from command import parser_of, print_result

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy and JAX count the processors
os.environ.setdefault("OMP_NUM_THREADS", "1")
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import jax
import numpy as np
import simulator_others as others
from numpy.typing import NDArray
from simulator_flights import DT, PLAIN, RICH, SAMPLES, Flights, errors, flights

from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler.integrate import along_path, trajectory
from bayeschute.compiler.runge_kutta import Stepping

Array = NDArray[np.float64]
Numbers = dict[str, Any]
SWING, DESCENT = 1e-3, 0.02  # wanted accuracy [deg], [ft/s]
BATCH, TIGHT, TURNS = 64, 16, 25


def best(works: Mapping[str, Callable[[], Any]], repeats: int = TURNS) -> dict[str, float]:
    """Least processor time of each [s], taken in turns after a first call that doesn't count."""
    found = dict.fromkeys(works, np.inf)
    for turn in range(repeats + 1):
        for name, work in works.items():
            start = process_time()
            jax.block_until_ready(work())
            if turn:
                found[name] = min(found[name], process_time() - start)
    return found


def milliseconds(times: Mapping[str, float]) -> dict[str, float]:
    """Times [s] in ms, as printed."""
    return {name: round(1e3 * t, 4) for name, t in times.items()}


def exponent(sizes: list[int], values: list[float]) -> float:
    """Slope of the logarithm of a quantity with that of a size."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def peak(work: Callable[[], Any]) -> float:
    """Most memory that NumPy takes in a call [byte]."""
    work()
    tracemalloc.start()
    work()
    size = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return float(size)


def apart(a: Array, b: Array) -> float:
    """Largest difference of states (T, X, B), in shares of the largest size of each."""
    return float(np.max(np.abs(a - b) / np.abs(b).max(axis=(0, 2), keepdims=True)))


def accurate(x: Array, tight: Array, of: Flights) -> bool:
    """Whether states are as near to the reference as asked."""
    if x.shape != tight.shape or not np.isfinite(x).all():
        return False
    swing, descent = errors(of.model, x, tight)
    return swing < SWING and descent < DESCENT


def accuracy(given: Flights, context: Numbers) -> Array:
    """States of all flights in tight steps (T, X, B); the simulator itself must be near enough to them."""
    model, *driven = given.all()
    tight = np.asarray(kernel.states(replace(model, stepping=model.stepping.finer(TIGHT)), *driven))
    ours = np.asarray(kernel.states(model, *driven))
    swing, descent = errors(model, ours, tight)
    context["errors"] = {"bayeschute": {"swing_deg": swing, "descent_ft_s": descent}}
    print(
        f"largest errors of {given.theta.shape[1]} flights in {model.stepping.substeps} steps per sample, against "
        f"{TIGHT} times"
    )
    print(f"  as many: swing {swing:.1e} deg, descent {descent:.1e} ft/s (asked: {SWING:.0e} deg, {DESCENT} ft/s)")
    if not accurate(ours, tight, given):
        raise SystemExit("the simulator itself is not as accurate as asked")
    return tight


def against_c(given: Flights, ratios: Numbers, context: Numbers) -> None:
    """Batch and single simulations, and what C and the pure JAX path take for them."""
    fly = jax.jit(trajectory)
    for kind, of, lanes in (("batch64_vs_c_soa", given, 8), ("single_vs_c_scalar", given.first(1), 1)):
        count = of.theta.shape[1]
        by_jax: Callable[[], Any] = (lambda of=of: fly(*of.all())) if count > 1 else (lambda of=of: fly(*of.one()))
        ours = np.asarray(kernel.states(*of.all()))
        works: dict[str, Callable[[], Any]] = {"bayeschute": lambda of=of: kernel.states(*of.all())}
        for options, simulate in others.c_programs(lanes):
            works[options] = lambda of=of, s=simulate, first=ours[0]: s(of.model, of.theta, first, of.error)
        differences = {name: apart(work(), ours) for name, work in works.items()}
        differences["JAX"] = apart(np.reshape(by_jax(), ours.shape), ours)
        times = {name: t / count for name, t in (best(works) | best({"JAX": by_jax}, 3)).items()}
        context[f"{kind}_ms_per_simulation"] = milliseconds(times)
        context[f"{kind}_states_differ_by"] = differences
        print(
            f"{'single' if count == 1 else f'batch of {count}'}, ms per simulation, and how far states are from ours:"
        )
        for name, t in times.items():
            print(f"  {1e3 * t:8.3f}  {differences[name]:.0e}  {name}")
        by_c = [t for name, t in times.items() if name not in ("bayeschute", "JAX")]
        if by_c:
            ratios[f"{kind}_time_ratio"] = times["bayeschute"] / min(by_c)
        else:
            print("  no C compiler here: not compared with C")


def solver_runs(given: Flights, tight: Array) -> Iterator[tuple[str, str, Callable[[], Array]]]:
    """Ratio, description and simulation of every solver with error control."""
    model, theta, _, error = given.one()
    first = np.ascontiguousarray(tight[0])
    task = model, theta, first, error

    def good(x: Array) -> bool:
        return accurate(x, tight, given)

    try:
        for how, run in others.diffrax_runs(*task, good):
            yield "speedup_vs_diffrax", how, run
    except ModuleNotFoundError:
        print("  diffrax is not installed (extra 'bench'): not compared")
    for in_c, how, run in others.scipy_runs(*task, good):
        yield "speedup_vs_scipy_with_rate_in_c" if in_c else "speedup_vs_scipy", how, run


def against_solvers(given: Flights, tight: Array, ratios: Numbers, context: Numbers) -> None:
    """A single flight by solvers with error control, as accurate as asked; the fastest of each kind counts."""
    one = given.one()
    print("single, as accurate as asked:")
    for key, how, run in solver_runs(given, tight):
        swing, descent = errors(given.model, run(), tight)
        repeats = 7 if key.endswith("diffrax") else 2
        times = best({"bayeschute": lambda: kernel.states(*one), how: run}, repeats)
        ratio = times[how] / times["bayeschute"]
        ratios[key] = min(ratios.get(key, np.inf), ratio)
        context["errors"][how] = {"swing_deg": swing, "descent_ft_s": descent}
        context.setdefault("solvers_ms", {})[how] = milliseconds(times)[how]
        print(f"  {1e3 * times[how]:8.2f} ms, {ratio:6.1f} times ours: {how}; {swing:.1e} deg, {descent:.1e} ft/s")


def jacobians(ratios: Numbers, context: Numbers) -> None:
    """Flight and derivatives of all its steps, by 20 parameters and by the wind at samples."""
    given = flights(RICH, SAMPLES, 1, axes=3).one()
    assert given[1].size == 20, given[1].size
    times = best(
        {
            "single": lambda: kernel.states(*given),
            f"and its steps by 20 parameters and {3 * SAMPLES} winds": lambda: kernel.along_path(
                *given, kernel.states(*given)
            ),
        }
    )
    context["jacobian_ms"] = milliseconds(times)
    print("a flight alone and with derivatives, ms:")
    for name, t in times.items():
        print(f"  {1e3 * t:8.2f}  {name}")
    single, by_steps = times.values()
    ratios["linearise_vs_single_time_ratio"] = by_steps / single


def growth(ratios: Numbers, context: Numbers) -> None:
    """Exponents of time and memory in record length and batch size."""
    for what, sizes in (("length", [226, 451, 901, 1801]), ("batch", [16, 32, 64, 128, 256])):
        made = {n: (flights(PLAIN, n, BATCH) if what == "length" else flights(PLAIN, SAMPLES, n)).all() for n in sizes}
        made = {n: (replace(model, stepping=Stepping(3)), *driven) for n, (model, *driven) in made.items()}
        times = best({str(n): lambda g=g: kernel.states(*g) for n, g in made.items()}, 7)
        by_time = exponent(sizes, [times[str(n)] for n in sizes])
        memory = exponent(sizes, [peak(lambda g=g: kernel.states(*g)) for g in made.values()])
        ratios[f"time_growth_exponent_{what}"], context[f"memory_growth_exponent_{what}"] = by_time, memory
        print(f"growth with {what} ({sizes[0]} to {sizes[-1]}): time ^{by_time:.2f}, memory ^{memory:.2f}")


def jax_steps(context: Numbers) -> None:
    """The derivatives of all steps by the pure JAX path."""
    given, work = (
        flights(RICH, SAMPLES, 1, axes=3).one(),
        jax.jit(lambda *flight: along_path(*flight, trajectory(*flight))),
    )
    taken = best({"JAX": lambda: work(*given)}, 3)
    context["steps_by_jax_ms"] = milliseconds(taken)["JAX"]
    print(f"derivatives of all steps by JAX: {1e3 * taken['JAX']:.0f} ms")


def main() -> None:
    """Measure, print, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "--jax-steps", action="store_true", help="time derivatives by pure JAX, too (compiles a minute)"
    )
    options = parser.parse_args()
    given = flights(PLAIN, SAMPLES, BATCH)
    why = kernel.why_not_compiled(*given.all())
    if why is not None:
        raise SystemExit(f"no machine code here: {why}")
    ratios: Numbers = {}
    context: Numbers = {
        "samples": SAMPLES,
        "dt_s": DT,
        "substeps": given.model.stepping.substeps,
        "compiler": others.compiler_version(),
    }
    tight = accuracy(given, context)
    against_c(given, ratios, context)
    against_solvers(given.first(1), np.ascontiguousarray(tight[..., 0]), ratios, context)
    jacobians(ratios, context)
    growth(ratios, context)
    if options.jax_steps:
        jax_steps(context)
    for name, value in ratios.items():
        print(f"{name:45} {value:8.2f}")
    print_result(options, ratios, context)


if __name__ == "__main__":
    main()
