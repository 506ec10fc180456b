"""How many descents per second does a GPU simulate, and are its numbers those of the processor?

Flights of 90 s of the default cluster at 10 Hz in 64-bit floats by the pure JAX path: parameters, starts and winds
differ, winds are linear between values 2 s apart, and of each flight the last state and the largest swing angle are
kept. The first flights are flown on the processor, too. Where JAX finds no GPU nothing is measured, and it says so.

    python benchmarks/gpu.py [--batches 4096 32768 131072] [--here] [--json]
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from command import parser_of, print_result
from simulator_flights import DT, PLAIN, SAMPLES, flights

from bayeschute.dynamics.cluster_flight import quantity

GOAL = 1e5  # flights per second on one H200
CHECKED, EVERY, AXES = 64, 20, 5  # flights compared with the processor; samples between values of the wind
TOLERANCE = 1e-7  # share of the largest size of every quantity


@jax.jit
def land(model: Any, theta: jax.Array, start: jax.Array, knots: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Last states (X, B) and largest swing angles (B,) of flights driven by disturbances at knots (K, A, B)."""
    numbers = model.numbers(theta)
    inputs = jax.tree.map(lambda a: jnp.asarray(a)[..., None], model.inputs())
    attach, n = model.base.capsule.attach_b, model.structure.canopies

    def swing(x: jax.Array) -> jax.Array:
        return quantity("swing_angle", x, inputs.density[0], attach, n)

    def drift(sample: jax.Array) -> jax.Array:
        at = jnp.minimum(sample // EVERY, knots.shape[0] - 2)
        return knots[at] + (knots[at + 1] - knots[at]) * ((sample - EVERY * at) / EVERY)

    def step(carried: Any, sample: jax.Array) -> tuple[Any, None]:
        x, widest = carried
        now, then = (jax.tree.map(lambda a, k=k: a[sample + k], inputs) for k in (0, 1))
        x = model.advance(x, numbers, now, then, drift(sample), drift(sample + 1))
        return (x, jnp.maximum(widest, swing(x))), None

    first = model.initial(numbers, start)
    return jax.lax.scan(step, (first, swing(first)), jnp.arange(inputs.density.shape[0] - 1))[0]


def drivers(model: Any, centre: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
    """Parameters, starts and disturbances at knots of so many flights; the first do not depend on how many."""
    rng, knots = np.random.default_rng(2), -(-(SAMPLES - 1) // EVERY) + 1
    deviations = 9 + 4 * model.structure.canopies
    scale = np.where(np.arange(AXES) < 3, 0.2, 0.02)
    drawn = rng.standard_normal((count, centre.size + deviations + knots * AXES))  # row by row
    theta, start, wind = np.split(drawn, [centre.size, centre.size + deviations], axis=1)
    error = wind.reshape(count, knots, AXES) * scale
    theta = centre + np.clip(theta, -3.0, 3.0) * 0.005 * np.abs(centre)
    return tuple(np.ascontiguousarray(np.moveaxis(a, 0, -1)) for a in (theta, 0.01 * start, error))


def timed(device: Any, model: Any, given: tuple[np.ndarray, ...], repeats: int = 3) -> tuple[float, list[np.ndarray]]:
    """Least time of a batch [s] without transfers and compilation, and its results."""
    placed = jax.device_put((model, *given), device)
    results = jax.block_until_ready(land(*placed))
    least = np.inf
    for _ in range(repeats):
        start = perf_counter()
        jax.block_until_ready(land(*placed))
        least = min(least, perf_counter() - start)
    return least, [np.asarray(r) for r in results]


def device_of(here: bool) -> Any | None:
    """The first GPU, or JAX's first device, or None."""
    if here:
        return jax.devices()[0]
    try:
        return jax.devices("gpu")[0]
    except RuntimeError:
        return None


def main() -> None:
    """Measure, print, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--batches", type=int, nargs="+", default=[4096, 32768, 131072])
    parser.add_argument("--here", action="store_true", help="run on JAX's first device, whatever that is")
    options = parser.parse_args()
    device, ratios, context = device_of(options.here), {}, {"goal_per_second": GOAL}
    if device is None:
        print("not run: JAX finds no GPU here (a CUDA build is the extra 'gpu'; --here tries the script without one)")
        print_result(options, {}, context | {"run": False})
        return
    some = flights(PLAIN, SAMPLES, 1)
    model, centre = some.model, some.theta[:, 0]
    by_cpu, want = timed(jax.devices("cpu")[0], model, drivers(model, centre, CHECKED), 1)
    print(f"{device.device_kind}: flights of {(SAMPLES - 1) * DT:.0f} s in {model.stepping.substeps} steps per sample")
    rates, worst = {}, 0.0
    for count in options.batches:
        taken, got = timed(device, model, drivers(model, centre, max(count, CHECKED)))
        pairs = [(g[..., :CHECKED], w) for g, w in zip(got, want, strict=True)]
        difference = max(float(np.max(np.abs(g - w) / np.abs(w).max(axis=-1, keepdims=True))) for g, w in pairs)
        rates[count], worst = max(count, CHECKED) / taken, max(worst, difference)
        failed = int(np.sum(~np.isfinite(got[0]).all(axis=0)))
        print(
            f"  batch {count:6d}: {taken:8.3f} s, {rates[count]:9.0f} per second, {failed} failed, off {difference:.0e}"
        )
    if not worst < TOLERANCE:
        raise SystemExit(f"the numbers differ from those of the processor by {worst:.1e} (allowed: {TOLERANCE:.0e})")
    fastest = max(rates.values())
    print(f"{fastest:.0f} flights per second (goal on one H200: {GOAL:.0f}); same numbers within {worst:.0e}")
    ratios["device_vs_cpu_jax_speedup"] = fastest * by_cpu / CHECKED
    context |= {"run": True, "device": device.device_kind, "per_second": rates, "differs_by": worst}
    print_result(options, ratios, context)


if __name__ == "__main__":
    main()
