"""Does it pay to treat the damper of the risers apart from the rest of the equations?

The damper makes the equations stiff: classical Runge-Kutta steps must be shorter than its fastest pole allows. Here
its impulse is taken exactly (an exponential of the small matrix that couples the risers), half a step before and half
a step after a Runge-Kutta step of all else (Strang's splitting). Printed for a virtual drop of 90 s, at the vehicle's
damping and at five times it: errors of swing angle and descent rate against steps of 1/64 sample, rates, time.

It does not pay, the less beside `compiler.runge_kutta.EXTENDED`: split steps stay stable at any length, but are of
second order only. For a swing angle to 1e-3 deg they want 12 steps a sample where Runge-Kutta wants 3, and 48 where it
wants 12 at five times the damping.

    python benchmarks/riser_damper.py [vehicle.toml]
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.atmosphere.standard import standard_density
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import geometry, state_rate
from bayeschute.dynamics.cluster_flight import ClusterFlight, ClusterInputs, quantity
from bayeschute.dynamics.initial_state import tangent_basis
from bayeschute.dynamics.state import unpack
from bayeschute.study.assembly import assemble
from bayeschute.study.load import load_study_or_vehicle
from bayeschute.virtual.drop import start_of

ENOUGH = {"swing [deg]": 1e-3, "descent [m/s]": 0.02 * 0.3048}  # what issue and report ask for
STEPS = {"Runge-Kutta 4": (3, 4, 6, 8, 12, 16, 24), "split, Runge-Kutta 4": (1, 2, 3, 4, 6, 8, 12, 16, 24, 48)}


def drop_of(path: Path) -> ClusterFlight:
    """The virtual drop of a vehicle, in a steady atmosphere at its altitude of start."""
    study = load_study_or_vehicle(path)
    flight = next(f for f in study.flights if f.virtual is not None)
    model, structure = assemble.cluster(study.vehicle, flight.capsule_mass)
    if model.capsule.products is not None:
        raise ValueError("a capsule with products of inertia: this benchmark wants principal axes")
    drop = assemble.drop(flight.virtual)
    start, n = start_of(drop, model, structure.canopies), structure.canopies
    samples = round(drop.duration / drop.dt) + 1
    altitude = drop.altitude - start.velocity[2] * drop.dt * np.arange(samples)
    wind = drop.wind.at(altitude)
    inputs = ClusterInputs(wind, standard_density(altitude), np.ones((samples, n)), np.zeros((samples, 4)))
    return ClusterFlight(model, start, tangent_basis(start.direction), inputs, drop.dt, structure, (), ())


def damped(x: jax.Array, one: ClusterFlight, density: jax.Array, h: jax.Array) -> jax.Array:
    """State after the dampers of taut risers have worked for `h`, everything else at rest."""
    n, model = one.structure.canopies, one.base
    state = unpack(x, n)
    geo = geometry(state, model.capsule)
    d = geo.direction.stack()  # (3, n): stretch rate = d . (canopy velocity - attach velocity)
    to_body = jnp.stack([state.attitude.to_body(Vec3(*d[:, i])).stack() for i in range(n)])
    arm, inertia = (jnp.asarray([v.x, v.y, v.z]) for v in (model.capsule.attach_b, model.capsule.inertia))
    turning = jnp.cross(jnp.broadcast_to(arm, (n, 3)), to_body)  # what a body rate takes off a stretch rate
    mass = model.canopies.dry_mass + density * model.canopies.enclosed_volume
    mobility = jnp.eye(n) / mass + d.T @ d / model.capsule.mass + (turning / inertia) @ turning.T
    taut = jnp.where(geo.length > model.risers.length, model.risers.damping, 0.0)
    root = jnp.sqrt(taut + 1e-9)
    value, vector = jnp.linalg.eigh(root[:, None] * mobility * root[None, :])
    decayed = (1.0 - jnp.exp(-value * h)) / value  # integral of the stretch rates, in scaled coordinates
    impulse = root * (vector @ (decayed * (vector.T @ (root * geo.stretch_rate))))
    x = x.at[3:6].add(d @ impulse / model.capsule.mass)
    x = x.at[10:13].add(turning.T @ impulse / inertia)
    pulled = -(d * impulse) / mass  # (3, n)
    return x.at[13 + 3 * n : 13 + 6 * n].add(pulled.reshape(-1))


@partial(jax.jit, static_argnames="split")
def fly(one: ClusterFlight, substeps: jax.Array, split: bool) -> jax.Array:
    """States (T, X) with so many steps a sample."""
    base = one.base
    calm = replace(base, risers=replace(base.risers, damping=0.0 * base.risers.damping)) if split else base
    h, none = one.dt / substeps, jnp.zeros(3)

    def sample(x: jax.Array, now_then: Any) -> tuple[jax.Array, jax.Array]:
        now, then = now_then

        def rate(state: jax.Array, share: jax.Array) -> jax.Array:
            return state_rate(state, calm, one.structure, one.air(state, now, then, none, none, share))

        def step(i: jax.Array, state: jax.Array) -> jax.Array:
            s, half = i / substeps, 0.5 / substeps
            first, last = (now.density + (then.density - now.density) * (s + 2.0 * half * part) for part in (0, 1))
            state = damped(state, one, first, 0.5 * h) if split else state
            k1 = rate(state, s)
            k2 = rate(state + 0.5 * h * k1, s + half)
            k3 = rate(state + 0.5 * h * k2, s + half)
            k4 = rate(state + h * k3, s + 2.0 * half)
            state = state + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
            return damped(state, one, last, 0.5 * h) if split else state

        x = jax.lax.fori_loop(0, substeps, step, x)
        return x, x

    first = one.initial(base, jnp.zeros(9 + 4 * one.structure.canopies))
    now, then = (jax.tree.map(lambda a, part=part: a[part], one.record) for part in (slice(None, -1), slice(1, None)))
    _, rest = jax.lax.scan(sample, first, (now, then))
    return jnp.concatenate([first[None], rest])


@jax.jit
def seen(one: ClusterFlight, states: jax.Array) -> jax.Array:
    """Swing angle [deg] and descent rate [m/s] (2, T)."""
    n, attach = one.structure.canopies, one.base.capsule.attach_b
    swing = quantity("swing_angle", states.T, one.record.density, attach, n)
    return jnp.stack([jnp.rad2deg(swing), quantity("descent_rate", states.T, one.record.density, attach, n)])


def measure(one: ClusterFlight) -> dict[str, float]:
    """Print a table; the shortest time at which each method is good enough [ms]."""
    exact = np.asarray(seen(one, fly(one, jnp.asarray(64), False)))
    best = {}
    print(f"{'method':22}{'steps':>7}{'rates':>7}{'time [ms]':>11}" + "".join(f"{name:>16}" for name in ENOUGH))
    for method, several in STEPS.items():
        best[method] = np.inf
        for m in several:
            split = method.startswith("split")
            states = fly(one, jnp.asarray(m), split).block_until_ready()
            spent = []
            for _ in range(3):
                began = time.perf_counter()
                fly(one, jnp.asarray(m), split).block_until_ready()
                spent.append(1e3 * (time.perf_counter() - began))
            error = np.abs(np.asarray(seen(one, states)) - exact).max(axis=1)
            shown = "".join(f"{e:16.2e}" for e in error)
            print(f"{method:22}{m:7d}{4 * m:7d}{min(spent):11.1f}{shown}")
            if (error < np.array(list(ENOUGH.values()))).all():
                best[method] = min(best[method], min(spent))
    return best


def main() -> None:
    """Measure at the vehicle's damping and at five times it."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("models/vehicles/cpas-two-mains.toml")
    one = drop_of(path)
    for factor in (1.0, 5.0):
        risers = replace(one.base.risers, damping=factor * one.base.risers.damping)
        print(f"\nDamping x {factor:g}")
        best = measure(replace(one, base=jax.tree.map(float, replace(one.base, risers=risers))))
        wanted = ", ".join(f"{name} < {bound:.2g}" for name, bound in ENOUGH.items())
        print(f"Shortest time with {wanted}: " + "; ".join(f"{name} {ms:.1f} ms" for name, ms in best.items()))


if __name__ == "__main__":
    main()
