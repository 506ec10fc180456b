"""Numbers of the three-body cluster (report 6.3.3), as pytrees that may carry trailing batch axes."""

from __future__ import annotations

from dataclasses import dataclass, field

import jax

from bayeschute.air.vector import Component, Vec3

STANDARD_GRAVITY = 9.80665  # [m/s^2]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Capsule:
    """A rigid capsule with six degrees of freedom (6.3.3-10..22).

    Attributes:
        mass: [kg].
        inertia: Principal moments of inertia about the centre of mass [kg m^2].
        attach_b: Riser attach point from the centre of mass, body axes [m].
        reference_centre_b: Aerodynamic reference centre from the centre of mass, body axes [m].
        area: Reference area [m^2].
        length: Reference length [m].
        axial_force: C_A, constant (6.3.3-11).
        normal_force_slope: Slope of the force across the body axis with the sine of the total angle of attack [1/rad].
        moment_slope: Slope of the static moment about the reference centre with that sine [1/rad].
        roll_damping: C_lp (6.3.3-13).
        pitch_damping: C_mq = C_nr.
    """

    mass: Component
    inertia: Vec3
    attach_b: Vec3
    reference_centre_b: Vec3
    area: Component
    length: Component
    axial_force: Component
    normal_force_slope: Component
    moment_slope: Component
    roll_damping: Component
    pitch_damping: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Canopies:
    """Equal canopies as particles with enclosed air.

    Attributes:
        area: Reference area S of one canopy [m^2].
        length: Reference length l [m].
        speed: Reference speed V_o [m/s].
        dry_mass: m_d of one canopy [kg].
        enclosed_volume: V_ea [m^3]; the enclosed mass is the local air density times this.
    """

    area: Component
    length: Component
    speed: Component
    dry_mass: Component
    enclosed_volume: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Risers:
    """Tension-only elastic risers (6.3.3-1..3): unstretched length [m], stiffness [N/m], damping [N s/m]."""

    length: Component
    stiffness: Component
    damping: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Cluster:
    """All numbers of the cluster; `axial` and `transverse` are the coefficients of the structure's terms."""

    capsule: Capsule
    canopies: Canopies
    risers: Risers
    axial: tuple[Component, ...]
    transverse: tuple[Component, ...]
    gravity: Component = STANDARD_GRAVITY


@dataclass(frozen=True)
class Structure:
    """What stays fixed while parameters vary: terms, number of canopies, definition of the transverse rate.

    Attributes:
        axial: Terms of the axial coefficient (`bayeschute.aero.terms`).
        transverse: Terms of the transverse coefficient.
        canopies: Number of canopies.
        rate: ``"riser"`` (rate of the riser alone) or ``"airflow"`` (of the wind direction relative to the riser).
    """

    axial: tuple[str, ...]
    transverse: tuple[str, ...]
    canopies: int = 2
    rate: str = field(default="riser")
