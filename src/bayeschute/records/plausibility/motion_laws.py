"""Laws between positions, velocities, attitude, rates and specific force: one rigid body moves under gravity."""

from __future__ import annotations

import numpy as np

from bayeschute.atmosphere.standard import STANDARD_GRAVITY
from bayeschute.records.foreign.attitudes import product
from bayeschute.records.plausibility.evidence import (
    Array,
    Evidence,
    boxcar,
    conjugate,
    mean,
    slope,
    spread,
    turned,
    typical,
)
from bayeschute.records.plausibility.reading import Reading, reading

_LAG, _SHORT = 2.0, 1.5  # over which displacements, and turns, are compared [s]
_BIAS = 0.03  # of a gyro [rad/s]
_UNLIKE = 0.2  # velocities of canopies that differ by less don't tell one from the other [m/s]
_DEG = float(np.rad2deg(1.0))
_DOWN = np.array([0.0, 0.0, 1.0])
_FASTEST, _SLOWEST = 150.0, 0.5  # vertical speeds of a descent [m/s]


def clock(e: Evidence) -> list[Reading]:
    """The sample interval is one that flights are recorded at."""
    got = f"a sample every {e.step:.3g} s for {e.time[-1] - e.time[0]:.4g} s"
    excess = abs(np.log10(e.step / 0.1)) / 2.0
    return [Reading("clock", "sample interval", float(excess), got, "1 ms to 10 s between samples")]


def velocity(e: Evidence) -> list[Reading]:
    """Displacements are the integral of velocity."""
    if e.position is None or e.velocity is None:
        return []
    return _moving(e, e.position, e.velocity, "velocity", "d(position)/dt against velocity")


def canopy_velocity(e: Evidence) -> list[Reading]:
    """Displacements of every canopy are the integral of its velocity, and of two canopies that of its own."""
    if e.canopies is None or e.canopy_velocity is None:
        return []
    tests = "d(canopy position)/dt against canopy velocity"
    out = _moving(e, e.canopies, e.canopy_velocity, "canopy_velocity", tests)
    if e.canopies.shape[1] != 2:
        return out
    k = e.samples(_LAG)
    moved, said = slope(e.canopies, k, e.step), boxcar(e.canopy_velocity, k)
    unlike, told = (np.diff(x[..., :2], axis=1)[:, 0] for x in (moved, said))
    both = np.isfinite(unlike).all(axis=1) & np.isfinite(told).all(axis=1)
    if both.sum() > 50 and min(spread(unlike[both]), spread(told[both])) > _UNLIKE:
        likeness = float(np.corrcoef(unlike[both].ravel(), told[both].ravel())[0, 1])
        tests = "difference of the canopies' velocities against that of d(position)/dt"
        got, excess = f"a correlation of {likeness:.2f}", max(0.0, -likeness / 0.3)
        out.append(Reading("canopy_velocity.order", tests, excess, got, "a positive one"))
    return out


def _moving(e: Evidence, place: Array, moving: Array, law: str, tests: str) -> list[Reading]:
    """Readings, horizontal and down, of positions against velocities (T, ..., 3)."""
    k = e.samples(_LAG)
    moved, said = slope(place, k, e.step), boxcar(moving, k)
    out = []
    for name, part in ((f"{law}.horizontal", slice(0, 2)), (f"{law}.down", slice(2, 3))):
        speed = min(spread(moved[..., part]), spread(said[..., part]))
        far = spread(moved[..., part] - said[..., part])
        out += reading(name, tests, far, 0.7 + 0.1 * speed, "{:.2g} m/s apart")
    return out


def falling(e: Evidence) -> list[Reading]:
    """What hangs under a parachute comes down, at a speed that parachutes have."""
    ways = {"position": e.position, "altitude": e.altitude, "velocity": e.velocity, "descent_rate": e.descent_rate}
    out = []
    for name, values in ways.items():
        if values is None:
            continue
        down = values[:, 2] if values.ndim == 2 else (-values if name == "altitude" else values)
        rate = slope(down, e.samples(_LAG), e.step) if name in ("position", "altitude") else down
        speed = typical(rate)
        if not np.isfinite(speed):
            continue
        slow, fast = 0.5 + (_SLOWEST - speed) / 2.0, np.log(max(speed, 1e-9) / 10.0) / np.log(_FASTEST / 10.0)
        excess = float(np.clip(max(slow, fast), 0.0, 5.0))
        got, wanted = f"a median of {speed:.3g} m/s downwards", f"{_SLOWEST:g} to {_FASTEST:g} m/s"
        out.append(Reading(f"falling.{name}", f"descent by {name}", excess, got, wanted))
    return out


def altitude(e: Evidence) -> list[Reading]:
    """Altitude goes with minus the position downward, and the recorded descent rate with both."""
    if e.altitude is None:
        return []
    out, k = [], e.samples(_LAG)
    climb = slope(e.altitude, k, e.step)
    if e.position is not None:
        down = slope(e.position[:, 2], k, e.step)
        tests = "d(altitude)/dt against d(down)/dt"
        scale = 0.5 + 0.1 * min(spread(climb), spread(down))
        out += reading("altitude.rate", tests, spread(climb + down), scale, "{:.2g} m/s apart")
        apart = typical(e.altitude + e.position[:, 2])
        tests = "altitude against minus down"
        out += reading("altitude.datum", tests, min(abs(apart) / 100.0, 0.99), 1.0, f"{apart:.4g} m apart", "one datum")
    if e.descent_rate is not None:
        said = boxcar(e.descent_rate, k)
        scale = 1.0 + 0.15 * min(spread(climb), spread(said))
        tests = "d(altitude)/dt against descent rate"
        out += reading("altitude.descent_rate", tests, spread(climb + said), scale, "{:.2g} m/s apart")
    return out


def attitude(e: Evidence) -> list[Reading]:
    """Quaternions have norm one, and turn as the gyros say."""
    if e.attitude is None:
        return []
    norm = typical(np.linalg.norm(e.attitude, axis=1))
    out = reading("attitude.norm", "norm of the quaternion", norm - 1.0, 0.02, "1 {:+.3f}", "1 within 0.02")
    if e.rate is None:
        return out
    k = 1  # rotations do not commute: over longer spans a rocking body seems to roll
    unit = e.attitude / np.linalg.norm(e.attitude, axis=1, keepdims=True)
    turn = product(conjugate(unit[:-k]), unit[k:])
    turn = turn * np.where(turn[:, :1] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, turn[:, :1])
    shown = turn[:, 1:] / np.where(size > 0.0, size, 1.0) * angle / (k * e.step)
    n = e.samples(_SHORT)
    shown, said = boxcar(shown, n), boxcar(boxcar(e.rate, k), n)  # noise of the attitude averages out, turns stay
    for j, axis in enumerate("xyz"):
        scale = 0.007 + 0.15 * min(spread(shown[:, j]), spread(said[:, j]))
        tests = f"d(attitude)/dt against angular rate about {axis}"
        apart = shown[:, j] - said[:, j]
        apart = apart - np.clip(typical(apart), -_BIAS, _BIAS)
        out += reading(f"attitude.rate.{axis}", tests, _DEG * spread(apart), _DEG * scale, "{:.2g} deg/s apart")
    return out


def specific_force(e: Evidence) -> list[Reading]:
    """Specific force is acceleration less gravity: near 1 g when hanging, and along the body's axes."""
    if e.force is None:
        return []
    size = typical(np.linalg.norm(e.force, axis=1)) / STANDARD_GRAVITY
    out = reading(
        "force.size", "size of the specific force", np.log(max(size, 1e-6)), 0.2, "exp({:+.2f}) g", "about 1 g"
    )
    out = [r._replace(got=f"a median of {size:.3g} g") for r in out]
    if e.attitude is None or e.velocity is None:
        return out
    k = e.samples(_LAG)
    shown = slope(e.velocity, k, e.step) - STANDARD_GRAVITY * _DOWN
    said = boxcar(turned(e.attitude, e.force), k)
    tests = "dv/dt less gravity against the specific force, turned by the attitude"
    side = min(spread(shown[:, :2]), spread(said[:, :2]))
    far = spread(shown[:, :2] - said[:, :2])
    out += reading("force.horizontal", tests, far, 0.18 + 0.2 * side, "{:.2g} m/s^2 apart")
    moved, felt = (x[:, 0] + 1j * x[:, 1] for x in (shown, said))
    seen = np.isfinite(moved) & np.isfinite(felt)
    if seen.sum() > 50 and side > 0.2:
        share = complex(np.vdot(felt[seen], moved[seen])) / max(float(np.vdot(felt[seen], felt[seen]).real), 1e-12)
        got = f"{abs(share):.2f} of it, turned by {np.rad2deg(np.angle(share)):.0f} deg"
        about = "horizontal dv/dt per specific force, turned by the attitude"
        out.append(Reading("force.turn", about, float(abs(share - 1.0) / 0.25), got, "all of it, not turned"))
    out += reading("force.down", tests, spread(shown[:, 2] - said[:, 2]), 0.6, "{:.2g} m/s^2 apart")
    return out


def hanging(e: Evidence) -> list[Reading]:
    """The risers pull at the attach point: specific force points to its side, and the canopies are above."""
    out = []
    if e.vehicle is not None:
        reach, size = e.vehicle.attach_b, float(np.linalg.norm(e.vehicle.attach_b))
        if e.force is not None and size > 0.0:
            f = np.array([typical(x) for x in e.force.T])
            tests = "direction of the mean specific force against the attach point, body axes"
            out += _leaning("hanging.force", tests, float(f @ reach / (np.linalg.norm(f) * size + 1e-12)))
        if e.attitude is not None and size > 0.0:
            up = -turned(e.attitude, reach / size)[:, 2]
            out += _leaning("hanging.attitude", "attach point, turned by the attitude, against up", typical(up))
    if e.canopies is not None and e.position is not None:
        apart = mean(e.canopies, 1) - e.position
        cosine = typical(-apart[:, 2] / np.linalg.norm(apart, axis=1))
        out += _leaning("hanging.canopies", "canopies above the capsule", cosine, " off the vertical")
    return out


def _leaning(law: str, tests: str, cosine: float, off: str = "") -> list[Reading]:
    """A reading of the angle between two directions that should be near each other."""
    if not np.isfinite(cosine):
        return []
    excess = (1.0 - cosine) / (1.0 - np.cos(np.deg2rad(50.0)))
    got = f"{np.rad2deg(np.arccos(np.clip(cosine, -1, 1))):.0f} deg{off}"
    return [Reading(law, tests, excess, got, "below 50 deg")]


LAWS = (clock, velocity, canopy_velocity, falling, altitude, attitude, specific_force, hanging)


def earth_force(e: Evidence) -> Array | None:
    """Acceleration less gravity of the capsule, NED (T - k, 3) [m/s^2], and so what its mass is pulled by."""
    if e.velocity is None:
        return None
    return slope(e.velocity, e.samples(_LAG), e.step) - STANDARD_GRAVITY * _DOWN


def over_lag(e: Evidence, x: Array) -> Array:
    """A series as `earth_force` has its times: means over the same spans."""
    return boxcar(x, e.samples(_LAG))
