"""Studies of the planar dumbbell: stability, limit cycle, bistability, pivot point (6.3.1.2, 7.1, F-1..F-4)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayeschute.core.vectors import Component
from bayeschute.reduced.dumbbell import Dumbbell, steady_descent, steady_speed
from bayeschute.reduced.motion import CYCLING, STEP, Array, Cycle, Motion, amplitude, cycle, ending, fly
from bayeschute.reduced.pendulum import decay_rate, induced_damping, natural_frequency, pendulum, pivot_distance
from bayeschute.reduced.planar import PlanarAero

_TAIL = 120.0  # [s], some eight cycles


def limit_cycle(model: Dumbbell, aero: PlanarAero, density: float, duration: float = 400.0) -> Cycle | None:
    """The oscillation that a large swing ends in; None if it dies out.

    Args:
        model: Masses and sizes.
        aero: Coefficients.
        density: [kg/m^3].
        duration: [s], of which the last two minutes count.
    """
    motion, _ = fly(model, aero, density, _disturbed(model, aero, density, 0.45), duration)
    return cycle(motion.between(duration - _TAIL))


def _disturbed(model: Dumbbell, aero: PlanarAero, density: float, swing: ArrayLike, side: float = 0.0) -> Array:
    """Steady descent with a swing angle [rad]; arrays give a batch."""
    state = np.asarray(steady_descent(model, aero, density, side))
    angle = np.asarray(swing, float)
    out = np.broadcast_to(state.reshape(6, *(1,) * angle.ndim), (6, *angle.shape)).copy()
    out[4] += angle
    return out


def disturbed_descent(
    model: Dumbbell, aero: PlanarAero, density: float, swing: float = 0.02, duration: float = 200.0
) -> Motion:
    """A vertical descent that is disturbed by a swing angle [rad] (figure 7.1-8)."""
    return fly(model, aero, density, _disturbed(model, aero, density, swing), duration)[0]


class Configuration(NamedTuple):
    """One of the four designs of figures 7.1-10..13.

    Attributes:
        statically_stable: Whether alpha = 0 is the only equilibrium of the canopy.
        dynamically_stable: Whether C_Nalphadot > 0.
        trim: Trim angle [rad].
        motion: From the common start.
        ending: ``"limit cycle"``, ``"glide"`` or ``"vertical descent"``.
        cycle: The limit cycle, if it ends in one.
    """

    statically_stable: bool
    dynamically_stable: bool
    trim: float
    motion: Motion
    ending: str
    cycle: Cycle | None


def four_configurations(
    model: Dumbbell, aero: PlanarAero, density: float, swing: float = -0.3, duration: float = 300.0
) -> tuple[Configuration, ...]:
    """Statically and dynamically unstable and stable canopies from one start (figures 7.1-10..13).

    The report prints neither its start nor the curves of its statically stable canopy: for those see `PlanarAero`. The
    dynamically stable twin has the damping of opposite sign, as in figure 7.1-9.

    Args:
        model: Masses and sizes.
        aero: Coefficients; sizes count, signs are set here.
        density: [kg/m^3].
        swing: Swing angle at the start of a vertical descent [rad].
        duration: [s].

    Returns:
        In the order of the figures: unstable both ways, only dynamically, only statically, stable both ways.
    """
    found = []
    for stable, damping in ((False, -1.0), (True, -1.0), (False, 1.0), (True, 1.0)):
        design = replace(aero, statically_stable=stable, C_Nalphadot=damping * abs(aero.C_Nalphadot))
        motion, _ = fly(model, design, density, _disturbed(model, design, density, swing), duration)
        trim = float(design.trim())
        last = motion.between(duration - _TAIL)
        found.append(Configuration(stable, damping > 0.0, trim, motion, ending(motion, trim), cycle(last)))
    return tuple(found)


def damping_flip(
    model: Dumbbell, aero: PlanarAero, density: float, at: float = 50.0, swing: float = 0.4, duration: float = 250.0
) -> Motion:
    """A limit cycle whose damping changes sign (figure 7.1-9).

    Args:
        model: Masses and sizes.
        aero: Coefficients, with negative damping until `at`.
        density: [kg/m^3].
        at: When the sign changes [s].
        swing: Swing angle at the start of a vertical descent [rad].
        duration: Of the whole [s].
    """
    before, states = fly(model, aero, density, _disturbed(model, aero, density, swing), at)
    flipped = replace(aero, C_Nalphadot=-aero.C_Nalphadot)
    after, _ = fly(model, flipped, density, states[-1], duration - at)
    after = after._replace(time=after.time + at)
    return Motion(*(np.concatenate([b, a[1:]]) for b, a in zip(before, after, strict=True)))


class Bistability(NamedTuple):
    """Where a swing ends, by damping and by the disturbance of a glide.

    Attributes:
        damping: C_Nalphadot (D,) [s/rad].
        disturbance: Swing angle at the start (S,) [rad].
        amplitude: Of the swing at the end (D, S) [rad].
        before: The same, two minutes earlier (D, S) [rad].
        threshold: C_Nalphadot below which the linear pendulum about the glide grows [s/rad] (6.3.1-17, -23).
    """

    damping: Array
    disturbance: Array
    amplitude: Array
    before: Array
    threshold: float

    def cycles(self) -> NDArray[np.bool_]:
        """Where the swing has locked on a limit cycle: large, and no longer changing by 1 % (D, S)."""
        return (self.amplitude >= CYCLING) & (np.abs(self.amplitude - self.before) <= 0.01 * self.before)

    def bistable(self) -> NDArray[np.bool_]:
        """Where the smallest disturbance decays and the largest ends in the limit cycle (D,)."""
        return (self.amplitude[:, 0] < CYCLING) & self.cycles()[:, -1]


def bistability(
    model: Dumbbell,
    aero: PlanarAero,
    density: float,
    damping: ArrayLike,
    disturbance: ArrayLike = (0.05, 0.1, 0.2, 0.45),
    duration: float = 600.0,
) -> Bistability:
    """Final amplitudes over damping and disturbance.

    Args:
        model: Masses and sizes.
        aero: Coefficients other than C_Nalphadot.
        density: [kg/m^3].
        damping: C_Nalphadot (D,) [s/rad].
        disturbance: Swing angles added to a steady glide (S,) [rad], rising.
        duration: [s], of which the last two minutes count, compared with the two before.
    """
    values, angles = np.asarray(damping, float), np.asarray(disturbance, float)
    start = _disturbed(model, aero, density, angles, side=1.0)
    shape = (6, len(values), len(angles))
    begin = np.broadcast_to(start[:, None, :], shape)
    varied = {"C_Nalphadot": np.broadcast_to(values[:, None], shape[1:])}
    motion, _ = fly(model, aero, density, begin, duration, varied)
    last, before = (amplitude(motion.between(duration - n * _TAIL, duration - (n - 1) * _TAIL)) for n in (1, 2))
    return Bistability(values, angles, last, before, -_induced(model, aero, density))


def _induced(model: Dumbbell, aero: PlanarAero, density: float) -> float:
    p = pendulum(model, density, aero.axial(aero.trim()))
    return float(induced_damping(p, aero.C_Nalpha, steady_speed(model, aero, density)))


class Onset(NamedTuple):
    """Response of a steady glide to shear layers.

    Attributes:
        change: Change of the wind through the layer, along the plane (U,) [m/s]; positive blows against the glide.
        thickness: Of the layer (H,) [m].
        peak: Greatest swing angle (U, H) [rad].
        amplitude: Of the swing at the end (U, H) [rad].
        onset: First time at which the swing exceeds `angle`, from the top of the layer (U, H) [s]; NaN if never.
        angle: [rad].
        motion: All motions, arrays (T, U, H).
    """

    change: Array
    thickness: Array
    peak: Array
    amplitude: Array
    onset: Array
    angle: float
    motion: Motion


def shear_onset(
    model: Dumbbell,
    aero: PlanarAero,
    density: float,
    change: ArrayLike,
    thickness: ArrayLike,
    angle: float = float(np.deg2rad(15.0)),
    duration: float = 400.0,
) -> Onset:
    """A glide that falls through a layer of linear wind shear: does it take up the pendulum?

    The layer is met at the speed of the undisturbed descent, so that the wind is a ramp in time.

    Args:
        model: Masses and sizes.
        aero: Coefficients.
        density: [kg/m^3].
        change: Changes of the wind through the layer (U,) [m/s].
        thickness: Thicknesses of the layer (H,) [m], > 0.
        angle: Swing angle that counts as onset [rad].
        duration: [s], of which the last two minutes count for the amplitude.
    """
    winds, layers = np.asarray(change, float), np.asarray(thickness, float)
    start = np.asarray(steady_descent(model, aero, density))
    time = np.arange(int(round(duration / STEP)) + 1) * STEP
    share = np.clip(time[:, None, None] * start[3] / layers, 0.0, 1.0)
    motion, _ = fly(model, aero, density, start, duration, wind=share * winds[:, None])
    beyond = np.abs(motion.swing) > angle
    first = np.where(beyond.any(axis=0), time[beyond.argmax(axis=0)], np.nan)
    final = amplitude(motion.between(duration - _TAIL))
    return Onset(winds, layers, np.abs(motion.swing).max(axis=0), final, first, angle, motion)


QUANTITIES = ("payload mass", "density", "drag")


class PivotSensitivity(NamedTuple):
    """The pivot point when one quantity is scaled (F-1, F-3, F-4) and what else that changes.

    Attributes:
        factor: Of the quantity (F,).
        distance: L_L by quantity of `QUANTITIES` (3, F) [m]; large means a wide swing of the capsule.
        speed: Airspeed of the steady descent (3, F) [m/s]: the price (F-1, F-3).
        frequency: Natural frequency (3, F) [Hz].
        decay: b of the linear pendulum (3, F) [1/s]; negative grows: dynamic stability (F-2).
        swing: Amplitude of the limit cycle (3, F) [rad]; zero where there is none.
        elasticity: d ln L_L / d ln quantity (3,).
    """

    factor: Array
    distance: Array
    speed: Array
    frequency: Array
    decay: Array
    swing: Array
    elasticity: Array


def pivot_sensitivity(model: Dumbbell, aero: PlanarAero, density: float, factor: ArrayLike) -> PivotSensitivity:
    """How pivot point and limit cycle answer to payload mass, air density and drag (6.3.1-33).

    Args:
        model: Masses and sizes.
        aero: Coefficients; C_A0 is scaled for the drag.
        density: [kg/m^3]; the enclosed air follows it.
        factor: Factors (F,), > 0.
    """

    def scaled(scale: Component) -> tuple[Dumbbell, PlanarAero, Component]:
        body = replace(model, capsule_mass=model.capsule_mass * scale[0])
        return body, replace(aero, C_A0=aero.C_A0 * scale[2]), density * scale[1]

    def linear(scale: jax.Array) -> jax.Array:
        body, coefficients, air = scaled(scale)
        p = pendulum(body, air, coefficients.axial(coefficients.trim()))
        speed = steady_speed(body, coefficients, air)
        total = aero.C_Nalphadot + induced_damping(p, aero.C_Nalpha, speed)
        omega = natural_frequency(p, aero.C_Nalpha)
        rows = pivot_distance(p, aero.C_Nalpha), speed, omega / (2.0 * jnp.pi), decay_rate(p, total)
        return jnp.stack(jnp.broadcast_arrays(*rows))

    factors = np.asarray(factor, float)
    scales = np.ones((3, 3, len(factors)))
    for i in range(3):
        scales[i, i] = factors
    ends = [limit_cycle(*scaled(scale)) for scale in scales.reshape(3, -1).T]
    swing = np.array([end.amplitude if end else 0.0 for end in ends]).reshape(3, -1)
    slopes = np.asarray(jax.jacfwd(lambda s: jnp.log(linear(s)[0]))(jnp.ones(3)))
    distance, speed, frequency, decay = np.asarray(linear(jnp.asarray(scales)))
    return PivotSensitivity(factors, distance, speed, frequency, decay, swing, slopes)
