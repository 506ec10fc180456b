"""Flights of a simulator that has nothing in common with the product's, as sets for ``other_flights.py``.

Whoever has no flights of another program makes some here: a vehicle whose physics the product's terms can't express,
recorded by imperfect instruments, with true histories of a second flight and of twelve replicates of it.

    python benchmarks/other_flights.py --independent two-mains-1        # makes the set, fits and scores it
    python benchmarks/independent_flights.py OUT [--kind two-mains] [--seed 1]    # the files alone

What differs from the product's model, by intent:

| physics | here |
|---|---|
| canopy axis | follows the riser with a lag, is not the riser |
| force coefficients | tables of the angle of attack by monotone cubic interpolation, no polynomials |
| unsteady force | the airflow's direction less what it was a while ago (a wake), saturating with the angle |
| apparent mass | along the axis twice that across |
| other canopies | push with a Gaussian of the distance |
| capsule | axial force that falls with the angle, normal force of its own, damping in roll too |
| air | sums of Ornstein-Uhlenbeck processes, partly common to the bodies; on one kind intermittent |
| risers | unequal, longer or shorter than the drawing, stiffer or softer |

Instruments have constant errors, slow ones and white noise; canopies have outliers, gaps and an error of scale. Files
are those of set P in ``other_records.py``. Integration is by classical Runge-Kutta steps of 0.01 s.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from command import parser_of, print_result
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
GRAVITY, SEA_LEVEL, SCALE_HEIGHT = 9.80665, 1.225, 10_400.0  # [m/s^2], [kg/m^3], [m]
STEP, KEPT = 0.01, 0.1  # of the integration, and between samples that are kept [s]
REPLICATES, SETTLING = 13, 20.0  # flights with true histories; before the record [s]
_ANGLES = np.linspace(0.0, 1.6, 161)


def table(angles: Sequence[float], values: Sequence[float]) -> Array:
    """A coefficient at `_ANGLES` from a few points [rad], [1]."""
    return np.asarray(PchipInterpolator(angles, values)(_ANGLES), float)


@dataclass(frozen=True)
class Vehicle:
    """A vehicle as drawn, its aerodynamics, its air and its instruments; SI and radians.

    Attributes:
        canopies: Number of canopies.
        mass: Of the capsule.
        inertia: Its diagonal and the products xy, xz, yz.
        attach: Attach point from the centre of mass, body axes (x up).
        capsule: Reference area; C_A, C_N slope, C_m slope, C_mq; C_D as nominal.
        area: Of one canopy; then diameter, enclosed volume and dry mass.
        riser: Length, stiffness and damping of one riser.
        axial: C_A of a canopy at `_ANGLES`.
        normal: C_N likewise, positive where it restores.
        wake: Gain of the unsteady force, the angle at which it turns round, its delay [diameters flown].
        axis_lag: Time constant with which a canopy's axis follows its riser.
        repulsion: Coefficient of the push between canopies.
        gusts: Standard deviation; then pairs of time constant and weight.
        common: Share of the gusts' variance that all bodies have in common.
        intermittent: Whether the gusts' strength wanders.
        breathing: Relative amplitude of the axial force, and frequency [Hz].
        wind: Scale of the mean wind, and error of its estimate.
        start, ground: Altitudes.
        flyout: Of every riser off their mean at the start.
        accuracy: Of positions, velocities, attitude [rad], canopies: their white noise, of which others are multiples.
        slack: Standard deviation of what the drawing says of the risers' length.
    """

    canopies: int
    mass: float
    inertia: tuple[float, ...]
    attach: tuple[float, float, float]
    capsule: tuple[float, float, float, float, float, float]
    area: tuple[float, float, float, float]
    riser: tuple[float, float, float]
    axial: Array
    normal: Array
    wake: tuple[float, float, float]
    axis_lag: float
    repulsion: float
    gusts: tuple[float, tuple[tuple[float, float], ...]]
    breathing: tuple[float, float]
    wind: tuple[float, float]
    start: float
    ground: float
    flyout: float = 0.14
    common: float = 0.6
    intermittent: bool = False
    accuracy: tuple[float, float, float, float] = (0.05, 0.03, 0.0009, 0.12)
    slack: float = 0.25

    def tensor(self) -> Array:
        """Inertia (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


_NORMAL = (0.0, 0.08, 0.16, 0.26, 0.4, 0.6, 1.6)
_AXIAL = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8, 1.6)
TWO_MAINS = Vehicle(
    canopies=2, mass=9400.0, inertia=(21400.0, 18900.0, 17300.0, 260.0, -540.0, 160.0), attach=(2.3, 0.05, -0.2),
    capsule=(19.86, 0.95, 0.5, -0.1, -0.35, 0.9), area=(980.0, 35.3, 3970.0, 150.0), riser=(71.3, 219e3, 146e3),
    axial=table(_AXIAL, (0.90, 0.885, 0.86, 0.85, 0.82, 0.7, 0.3)),
    normal=table(_NORMAL, (0.0, 0.004, 0.010, 0.028, 0.07, 0.2, 0.5)),
    wake=(0.4, 0.42, 0.5), axis_lag=0.15, repulsion=0.025, gusts=(0.55, ((1.5, 0.6), (6.0, 0.8))),
    breathing=(0.02, 0.22), wind=(6.0, 0.35), start=2500.0, ground=300.0,
)  # fmt: skip
ONE_MAIN = replace(
    TWO_MAINS, canopies=1, mass=3600.0, inertia=(3700.0, 3200.0, 3000.0, 30.0, -90.0, 40.0), attach=(1.5, 0.03, 0.05),
    capsule=(7.5, 0.95, 0.5, -0.1, -0.35, 0.8), area=(600.0, 27.6, 1900.0, 90.0), riser=(55.0, 120e3, 70e3),
    axial=table(_AXIAL, (0.80, 0.80, 0.79, 0.75, 0.70, 0.6, 0.3)),
    normal=table(_NORMAL, (0.0, -0.006, -0.004, 0.012, 0.05, 0.2, 0.5)),
    wake=(0.35, 0.45, 0.45), gusts=(0.7, ((1.5, 0.6), (6.0, 0.8))), breathing=(0.02, 0.3), start=2100.0,
    intermittent=True,
)  # fmt: skip
SMALL = replace(
    TWO_MAINS, canopies=1, mass=7.4, inertia=(0.11, 0.15, 0.14, 0.004, -0.005, 0.003), attach=(0.11, 0.004, 0.008),
    capsule=(0.08, 0.95, 0.5, -0.1, -0.35, 0.9), area=(4.9, 2.5, 0.75, 0.33), riser=(3.1, 1800.0, 45.0),
    axial=table(_AXIAL, (0.88, 0.87, 0.85, 0.80, 0.75, 0.6, 0.3)),
    normal=table(_NORMAL, (0.0, -0.004, -0.002, 0.015, 0.05, 0.2, 0.5)),
    wake=(0.35, 0.4, 0.5), axis_lag=0.08, gusts=(0.35, ((0.4, 0.6), (2.0, 0.8))), breathing=(0.02, 0.9),
    wind=(3.0, 0.35), start=1000.0, ground=120.0, accuracy=(0.05, 0.05, 0.0017, 0.03), slack=0.05,
)  # fmt: skip
CALM = replace(
    TWO_MAINS, mass=7000.0, area=(820.0, 32.3, 3000.0, 120.0), riser=(60.0, 219e3, 146e3), wake=(0.15, 0.4, 0.4),
    axial=table(_AXIAL, (0.84, 0.84, 0.83, 0.82, 0.80, 0.7, 0.3)), repulsion=0.02, start=2300.0,
    normal=table(_NORMAL, (0.0, 0.004, 0.015, 0.05, 0.13, 0.25, 0.5)),
)  # fmt: skip
KINDS = {"two-mains": TWO_MAINS, "one-main": ONE_MAIN, "small": SMALL, "calm": CALM}


@dataclass(frozen=True)
class AsFlown:
    """A vehicle as it flies: what the drawing does not tell.

    Attributes:
        vehicle: As drawn.
        lengths: Of the risers (n,); `drags` are factors on the canopies' axial force.
        drags: (n,).
        stiffer: Factor on the risers' stiffness and damping.
        attach: (3,).
        inertia: (3, 3).
    """

    vehicle: Vehicle
    lengths: Array
    drags: Array
    stiffer: float
    attach: Array
    inertia: Array

    @classmethod
    def of(cls, vehicle: Vehicle, rng: np.random.Generator) -> AsFlown:
        """One of the vehicles that the drawing allows."""
        n, slack = vehicle.canopies, vehicle.slack
        lengths = vehicle.riser[0] + rng.normal(0.0, slack) + rng.normal(0.0, 0.25 * slack, n)
        drags, stiffer = 1.0 + rng.normal(0.0, 0.012, n), float(np.exp(rng.normal(0.0, 0.12)))
        attach = np.array(vehicle.attach) * (1.0 + rng.normal(0.0, 0.01))
        return cls(vehicle, lengths, drags, stiffer, attach, vehicle.tensor() * (1.0 + rng.normal(0.0, 0.004)))


@dataclass(frozen=True)
class Air:
    """Mean wind by altitude, as it is and as it is estimated, north and east (K, 2) [m/s]."""

    altitude: Array
    wind: Array
    estimate: Array = field(repr=False)

    @classmethod
    def of(cls, vehicle: Vehicle, rng: np.random.Generator) -> Air:
        """A smooth profile, and an estimate of it that is smoother, biased, and wanders."""
        altitude = np.arange(vehicle.ground - 60.0, vehicle.start + 200.0, 20.0)
        z, (scale, error) = (altitude - vehicle.ground) / 1000.0, vehicle.wind
        wind = rng.normal(0.0, scale, 2) * np.clip(z, 0.02, None)[:, None] ** 0.25
        for k in range(1, 5):
            wind = wind + rng.normal(0.0, 0.35 * scale / k, 2) * np.sin(
                2.0 * np.pi * k * z[:, None] / 2.2 + rng.uniform(0.0, 6.28, 2)
            )
        wander = gaussian_filter1d(rng.normal(size=wind.shape), 8.0, axis=0)
        estimate = gaussian_filter1d(wind, 4.0, axis=0) + rng.normal(0.0, error, 2) + error * wander / wander.std()
        return cls(altitude, wind, estimate)

    def at(self, altitude: Array, profile: Array) -> Array:
        """A profile's wind at altitudes (...,), NED (..., 3)."""
        north, east = (np.interp(altitude, self.altitude, profile[:, k]) for k in (0, 1))
        return np.stack([north, east, np.zeros_like(north)], axis=-1)


def density(altitude: Array) -> Array:
    """Of the air [kg/m^3]."""
    return np.asarray(1.2 * np.exp(-altitude / SCALE_HEIGHT))


def drift(rng: np.random.Generator, samples: int, dt: float, tau: float, shape: tuple[int, ...]) -> Array:
    """Ornstein-Uhlenbeck processes of unit variance (samples, *shape)."""
    made, keep = np.empty((samples, *shape)), np.exp(-dt / tau)
    made[0] = rng.normal(size=shape)
    fresh = np.sqrt(1.0 - keep**2) * rng.normal(size=(samples, *shape))
    for i in range(1, samples):
        made[i] = keep * made[i - 1] + fresh[i]
    return made


def _unit(v: Array) -> Array:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def _turned(q: Array, v: Array, back: bool = False) -> Array:
    """Vectors (..., 3) of the body in the earth's frame by quaternions (..., 4), scalar first; or `back`."""
    u = -q[..., 1:] if back else q[..., 1:]
    across = 2.0 * np.cross(u, v)
    return np.asarray(v + q[..., :1] * across + np.cross(u, across))


class Flights:
    """Flights of one vehicle in one mean wind at once, which differ in turbulence and breathing.

    States (M, X): position, velocity, quaternion, rate, then of every canopy position, velocity, axis, wake (n, 3).

    Args:
        flown: The vehicle.
        air: Mean winds.
        mass: Of the capsule [kg].
        count: Number M.
        rng: Of the disturbances.
    """

    def __init__(self, flown: AsFlown, air: Air, mass: float, count: int, rng: np.random.Generator) -> None:
        self.flown, self.air, self.mass, self.count, self.rng = flown, air, mass, count, rng

    def start(self, swing: float, azimuth: float) -> Array:
        """A state that hangs at a swing angle [rad] and descends (X,)."""
        v, n = self.flown.vehicle, self.flown.vehicle.canopies
        up = np.array([np.sin(swing) * np.cos(azimuth), np.sin(swing) * np.sin(azimuth), -np.cos(swing)])
        y = _unit(np.cross([np.cos(1.1 + azimuth), np.sin(1.1 + azimuth), 0.2], up))
        body = np.stack([up, y, np.cross(up, y)], axis=-1)
        q = np.roll(Rotation.from_matrix(body).as_quat(), 1)
        high = np.array([0.0, 0.0, -v.start])
        drag = density(np.array(v.start)) * n * v.area[0] * v.axial[0]
        fall = np.sqrt(2.0 * GRAVITY * (self.mass + n * v.area[3]) / drag)
        velocity = self.air.at(np.array(v.start), self.air.wind) + np.array([0.0, 0.0, fall])
        round_ = 2.0 * np.pi * np.arange(n)[:, None] / n
        aside = 0.0 if n == 1 else v.flyout
        line = np.cos(aside) * up + np.sin(aside) * (np.cos(round_) * body[:, 1] + np.sin(round_) * body[:, 2])
        place = high + body @ self.flown.attach + (self.flown.lengths[:, None] + 0.2) * line
        canopies = [place, np.tile(velocity, (n, 1)), -line, np.zeros((n, 3))]
        return np.concatenate([high, velocity, q, np.zeros(3), *(part.ravel() for part in canopies)])

    def rate(self, x: Array, gusts: Array, swell: Array) -> tuple[Array, Array, Array]:
        """Rate of the states, specific force of the capsule (M, 3), tensions (M, n)."""
        v, f, m = self.flown.vehicle, self.flown, len(x)
        n = v.canopies
        p, velocity, q, w = x[:, :3], x[:, 3:6], x[:, 6:10], x[:, 10:13]
        place, moving, axis, wake = (a.reshape(m, n, 3) for a in np.split(x[:, 13:], 4, axis=1))
        arm = np.broadcast_to(f.attach, w.shape)
        line = place - (p + _turned(q, arm))[:, None]
        length = np.linalg.norm(line, axis=-1)
        line = line / length[..., None]
        opening = ((moving - (velocity + _turned(q, np.cross(w, arm)))[:, None]) * line).sum(-1)
        taut = f.stiffer * (v.riser[1] * (length - f.lengths) + v.riser[2] * opening)
        tension = np.where(length > f.lengths, np.maximum(taut, 0.0), 0.0)
        pulls = tension[..., None] * line
        # canopies
        area, diameter, volume, dry = v.area
        air = moving - self.air.at(-place[..., 2], self.air.wind) - gusts[:, 1:]
        speed, rho = np.linalg.norm(air, axis=-1), density(-place[..., 2])
        along = (air * axis).sum(-1)
        e = (air - along[..., None] * axis) / speed[..., None]
        sine = np.linalg.norm(e, axis=-1)
        angle = np.arctan2(sine, along / speed)
        axial = np.interp(angle, _ANGLES, v.axial) * f.drags * (1.0 + swell)
        normal = np.interp(angle, _ANGLES, v.normal) / np.maximum(sine, 1e-9)
        gain = v.wake[0] * np.clip(1.0 - (angle / v.wake[1]) ** 2, -1.0, 1.0)
        force = -axial[..., None] * axis - normal[..., None] * e + gain[..., None] * (e - wake)
        for i in range(n):
            for j in (j for j in range(n) if j != i):
                apart = place[:, i] - place[:, j]
                far = np.linalg.norm(apart, axis=-1, keepdims=True)
                force[:, i] += v.repulsion * np.exp(-2.0 * (far / diameter) ** 2) * apart / far
        force = force * (0.5 * rho * speed**2 * area)[..., None] - pulls + np.array([0.0, 0.0, dry * GRAVITY])
        carried = rho * volume * (1.0 + 1.5 * swell)
        across, ahead = dry + 0.6 * carried, dry + 1.1 * carried
        lengthwise = (force * axis).sum(-1)
        speeding = force / across[..., None] + (lengthwise * (1.0 / ahead - 1.0 / across))[..., None] * axis
        following = (e - wake) / (v.wake[2] * diameter / np.maximum(speed, 1.0))[..., None]
        # capsule
        size, c_a, c_n, c_m, c_mq, _ = v.capsule
        wind = _turned(q, velocity - self.air.at(-p[:, 2], self.air.wind) - gusts[:, 0], back=True)
        fast = np.linalg.norm(wind, axis=-1, keepdims=True)
        aside = wind / fast * np.array([0.0, 1.0, 1.0])
        load, span = 0.5 * density(-p[:, 2])[:, None] * fast**2 * size, 2.0 * np.sqrt(size / np.pi)
        drag = c_a * (1.0 - 0.5 * (aside**2).sum(-1, keepdims=True))
        body = load * np.concatenate([drag, -c_n * aside[:, 1:]], axis=1)
        turning = np.stack([np.zeros(m), aside[:, 2], -aside[:, 1]], axis=-1) * c_m
        turning = turning + c_mq * w * span / (2.0 * fast) * np.array([0.2, 1.0, 1.0])
        pull = _turned(q, pulls.sum(1), back=True)
        moment = load * span * turning + np.cross(arm, pull)
        felt = (body + pull) / self.mass
        spin = np.linalg.solve(f.inertia, (moment - np.cross(w, w @ f.inertia.T)).T).T
        half = 0.5 * np.concatenate(
            [-(q[:, 1:] * w).sum(-1, keepdims=True), q[:, :1] * w + np.cross(q[:, 1:], w)], axis=1
        )
        capsule = [velocity, _turned(q, felt) + np.array([0.0, 0.0, GRAVITY]), half, spin]
        lag = (-line - axis) / v.axis_lag
        canopies = [part.reshape(m, -1) for part in (moving, speeding, lag, following)]
        return np.concatenate([*capsule, *canopies], axis=1), felt, tension

    def disturbances(self, samples: int) -> tuple[Array, Array]:
        """Gusts at capsule and canopies (T, M, 1 + n, 3) [m/s], breathing (T, M, n)."""
        v, rng, shape = self.flown.vehicle, self.rng, (self.count, self.flown.vehicle.canopies)
        strength, laws = v.gusts
        both = sum(weight * drift(rng, samples, STEP, tau, (self.count, 1, 3)) for tau, weight in laws)
        own = sum(weight * drift(rng, samples, STEP, tau, (self.count, 1 + shape[1], 3)) for tau, weight in laws)
        gusts = strength * np.array([1.0, 1.0, 0.6]) * (np.sqrt(v.common) * both + np.sqrt(1.0 - v.common) * own)
        if v.intermittent:
            gusts = gusts * np.exp(0.5 * drift(rng, samples, STEP, 25.0, (self.count, 1, 1)) - 0.125)
        (amplitude, frequency), swell = v.breathing, np.zeros((samples, *shape))
        omega, damping, eta, speed = 2.0 * np.pi * frequency, 0.07, np.zeros(shape), np.zeros(shape)
        kick = amplitude * np.sqrt(4.0 * damping * omega**3 * STEP)
        for i in range(samples):
            speed = speed - STEP * (2.0 * damping * omega * speed + omega**2 * eta) + kick * rng.normal(size=shape)
            eta = eta + STEP * speed
            swell[i] = eta
        return gusts, swell

    def fly(self, start: Array, longest: float | None = None) -> History:
        """Integrate from one state (X,), until all are on the ground or for so many seconds; None: twice what it takes.

        Raises:
            FloatingPointError: If a state is not finite.
        """
        if longest is None:
            longest = 2.0 * (-start[2] - self.flown.vehicle.ground) / start[5]
        count, every, x = int(longest / STEP), round(KEPT / STEP), np.tile(start, (self.count, 1))
        gusts, swell = self.disturbances(count + 1)
        n, rows = self.flown.vehicle.canopies, list[tuple[Array, Array, Array]]()
        for i in range(count):
            now, then = (gusts[i], swell[i]), (gusts[i + 1], swell[i + 1])
            middle = 0.5 * (now[0] + then[0]), 0.5 * (now[1] + then[1])
            first, felt, tension = self.rate(x, *now)
            if i % every == 0:
                rows.append((x, felt, tension))
                if not np.isfinite(x).all():
                    raise FloatingPointError(f"not finite after {i * STEP:g} s")
                if (-x[:, 2] < self.flown.vehicle.ground).all():
                    break
            second = self.rate(x + 0.5 * STEP * first, *middle)[0]
            third = self.rate(x + 0.5 * STEP * second, *middle)[0]
            x = x + STEP / 6.0 * (first + 2.0 * (second + third) + self.rate(x + STEP * third, *then)[0])
            x[:, 6:10] = _unit(x[:, 6:10])
            axes = slice(13 + 6 * n, 13 + 9 * n)
            x[:, axes] = _unit(x[:, axes].reshape(-1, n, 3)).reshape(self.count, -1)
        states, felt, tension = (np.stack(part) for part in zip(*rows, strict=True))
        return History(self, np.asarray(KEPT * np.arange(len(states)), np.float64), states, felt, tension)


@dataclass(frozen=True)
class History:
    """What flights did: time (T,), states (T, M, X), specific force (T, M, 3), tensions (T, M, n)."""

    flights: Flights
    time: Array
    states: Array
    felt: Array
    tension: Array

    def aloft(self, number: int) -> NDArray[np.bool_]:
        """Samples before a flight is on the ground (T,)."""
        return np.asarray(-self.states[:, number, 2] > self.flights.flown.vehicle.ground)

    def truth(self, number: int) -> dict[str, Array]:
        """True histories of one flight, as truth files have them."""
        x, n = self.states[self.aloft(number), number], self.flights.flown.vehicle.canopies
        arm = np.broadcast_to(self.flights.flown.attach, (len(x), 3))
        risers = x[:, 13 : 13 + 3 * n].reshape(-1, n, 3) - (x[:, :3] + _turned(x[:, 6:10], arm))[:, None]
        mean, line, down = risers.mean(axis=1), _unit(risers), x[:, 5]
        pairs = [(line[:, i] * line[:, j]).sum(-1) for i in range(n) for j in range(i)]
        flyout = np.mean([0.5 * np.arccos(np.clip(c, -1.0, 1.0)) for c in pairs], axis=0) if pairs else np.nan
        return {
            "time_s": np.round(self.time[: len(x)], 3),
            "swing_angle_deg": np.rad2deg(np.arctan2(np.hypot(mean[:, 0], mean[:, 1]), np.abs(mean[:, 2]))),
            "flyout_angle_deg": np.rad2deg(np.broadcast_to(flyout, down.shape)),
            "descent_rate_mps": down,
            "sea_level_descent_rate_mps": down * np.sqrt(density(-x[:, 2]) / SEA_LEVEL),
        }


def recorded(history: History, rng: np.random.Generator) -> pd.DataFrame:
    """The first flight as instruments record it."""
    flights, kept = history.flights, history.aloft(0)
    v, x, time = flights.flown.vehicle, history.states[kept, 0], history.time[kept]
    n, size, dt = v.canopies, len(x), KEPT
    place, speed, turn, seen = v.accuracy

    def errors(white: float, constant: float, slow: float, tau: float, *shape: int) -> Array:
        made = rng.normal(0.0, constant, shape) + slow * drift(rng, size, dt, tau, shape)
        return np.asarray(made + rng.normal(0.0, white, (size, *shape)))

    position = x[:, :3] + errors(place, 8.0 * place, 5.0 * place, 20.0, 3)
    velocity = x[:, 3:6] + errors(speed, 0.7 * speed, 1.3 * speed, 10.0, 3)
    small = errors(turn, 3.0 * turn, 2.0 * turn, 15.0, 3)
    q = np.roll(x[:, 6:10], -1, axis=1)
    attitude = np.roll((Rotation.from_quat(q) * Rotation.from_rotvec(small)).as_quat(), 1, axis=1)
    attitude *= np.where((attitude * x[:, 6:10]).sum(-1, keepdims=True) < 0.0, -1.0, 1.0)
    rate = x[:, 10:13] * (1.0 + rng.normal(0.0, 0.003, 3)) + errors(0.002, 0.001, 0.0, 1.0, 3)
    felt = history.felt[kept, 0] * (1.0 + rng.normal(0.0, 0.003, 3)) + errors(0.05, 0.03, 0.0, 1.0, 3)
    canopies = (x[:, 13 : 13 + 3 * n].reshape(-1, n, 3) - x[:, None, :3]) * (1.0 + rng.normal(0.0, 0.004))
    canopies = canopies + errors(seen, 0.0, 3.0 * seen, 1.0, n, 3) + rng.normal(0.0, 2.0 * seen, 3)
    canopies = canopies + position[:, None]
    far = rng.random((size, n)) < 0.003
    canopies[far] += rng.normal(0.0, 30.0 * seen, (int(far.sum()), 3))
    for k in range(n):
        for begin in rng.integers(0, size, 3):
            canopies[begin : begin + int(rng.uniform(0.3, 2.0) / dt), k] = np.nan
    lost = int(rng.integers(size // 4, size // 2))
    rate[lost : lost + int(0.8 / dt)] = felt[lost : lost + int(0.8 / dt)] = np.nan
    wind = flights.air.at(-x[:, 2], flights.air.estimate)
    air = density(-x[:, 2]) * (1.0 + rng.normal(0.0, 0.003)) * (1.0 + rng.normal(0.0, 0.0005, size))
    mean = history.tension[kept, 0].mean()
    load = history.tension[kept, 0] * (1.0 + rng.normal(0.0, 0.03, n)) + mean * errors(0.0, 0.01, 0.01, 5.0, n)
    columns: dict[str, Array] = {"time_s": time}
    for name, values, decimals in (
        ("capsule_{}_m", position, 3), ("capsule_v{}_mps", velocity, 4), ("omega_{}_radps", rate, 6),
        ("accel_{}_mps2", felt, 4), *((f"main{k + 1}_{{}}_m", canopies[:, k], 3) for k in range(n)),
    ):  # fmt: skip
        columns |= {name.format(axis): np.round(values[:, i], decimals) for i, axis in enumerate("xyz")}
    columns |= {f"quat_{part}": np.round(attitude[:, i], 6) for i, part in enumerate("wxyz")}
    columns |= {f"wind_{axis}_mps": np.round(wind[:, i], 3) for i, axis in enumerate("xy")}
    columns |= {"density_kgpm3": np.round(air, 6)}
    return pd.DataFrame(columns | {f"load{k + 1}_kN": np.round(load[:, k] / 1e3, 6) for k in range(n)})


def meta(vehicle: Vehicle, name: str, mass: float) -> dict[str, Any]:
    """What is known of a flight's configuration: nominal values but for the mass."""
    area, diameter, volume, dry = vehicle.area
    length, stiffness, damping = vehicle.riser
    return {
        "flight": name, "n_canopies": vehicle.canopies, "capsule_mass_kg": mass,
        "capsule_inertia_kgm2_body_about_cm": vehicle.tensor().tolist(),
        "attach_point_body_m_from_cm": list(vehicle.attach), "capsule_reference_area_m2": vehicle.capsule[0],
        "capsule_CD_estimate": vehicle.capsule[5], "canopy_nominal_diameter_m": diameter,
        "canopy_reference_area_m2": area, "canopy_dry_mass_kg": dry, "canopy_enclosed_volume_m3": volume,
        "line_length_unstretched_m": length, "riser_stiffness_Npm": stiffness, "riser_damping_Nspm": damping,
        "gravity_mps2": GRAVITY, "ground_altitude_msl_m": vehicle.ground, "sample_rate_hz": round(1.0 / KEPT),
        "reference_sea_level_density_kgpm3": SEA_LEVEL,
    }  # fmt: skip


def write_flight(folder: Path, name: str, history: History, rng: np.random.Generator) -> None:
    """Record, wind by altitude and meta file of the first of some flights."""
    flights = history.flights
    recorded(history, rng).to_csv(folder / f"{name}.csv.gz", index=False)
    rows = np.column_stack([flights.air.altitude, np.round(flights.air.estimate, 3)])
    names = ["altitude_msl_m", "wind_x_mps", "wind_y_mps"]
    pd.DataFrame(rows, columns=names).to_csv(folder / f"{name}_wind_profile.csv", index=False)
    told = meta(flights.flown.vehicle, name, flights.mass)
    (folder / f"{name}_meta.json").write_text(json.dumps(told, indent=1), encoding="utf-8")


def make_set(folder: Path, vehicle: Vehicle, seed: int, replicates: int = REPLICATES) -> None:
    """A set of two flights: the first to be identified, the second with true histories of it and its replicates.

    Args:
        folder: Where to; made if need be.
        vehicle: As drawn.
        seed: Of all that is random.
        replicates: Of the second flight, itself among them: same state and mean wind at the first sample.
    """
    rng = np.random.default_rng(seed)
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    flown = AsFlown.of(vehicle, rng)
    for name, count, heavier in (("P_1", 1, 1.0), ("P_2", replicates, float(rng.choice([0.94, 0.97, 1.05])))):
        air, mass = Air.of(vehicle, rng), round(vehicle.mass * heavier, 3)
        before = Flights(flown, air, mass, 1, rng)
        opened = before.fly(before.start(rng.uniform(0.1, 0.3), rng.uniform(0.0, 6.28)), SETTLING)
        history = Flights(flown, air, mass, count, rng).fly(opened.states[-1, 0])
        write_flight(folder, name, history, rng)
        if count > 1:
            for number in range(count):
                np.savez(folder / "truth" / f"{name}_{number:02d}.npz", allow_pickle=False, **history.truth(number))


def main() -> None:
    """Write a set."""
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path, help="folder of the set")
    parser.add_argument("--kind", choices=KINDS, default="two-mains")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    make_set(given.out, KINDS[given.kind], given.seed)
    print(f"{given.out}: P_1 and P_2, {given.kind}, seed {given.seed}; truths in {given.out / 'truth'}")
    print_result(given, {}, {"kind": given.kind, "seed": given.seed})


if __name__ == "__main__":
    main()
