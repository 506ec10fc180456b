"""Parameters of the cluster model (report 6.3.3), as pytrees that may carry trailing batch axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import jax

from bayeschute.aero.capsule_table import CapsuleTable
from bayeschute.core.vectors import Component, Vec3, dot

STANDARD_GRAVITY = 9.80665  # [m/s^2]
BIASES = {
    "wind_bias": ("m/s", ("north", "east")),
    "canopy_position_bias": ("m", ("north", "east", "down")),
    "capsule_attitude_bias": ("rad", ("y", "z")),
}
"""Constant errors of a flight's record, each a field of `Cluster`: its unit, and the axes it is along or about."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Capsule:
    """A rigid capsule with six degrees of freedom (6.3.3-10..22).

    Attributes:
        mass: [kg].
        inertia: Moments of inertia about the centre of mass, body axes: diagonal of the tensor [kg m^2].
        attach_b: Riser attach point from the centre of mass, body axes [m].
        reference_centre_b: Aerodynamic reference centre from the centre of mass, body axes [m].
        area: Reference area [m^2].
        length: Reference length [m].
        axial_force: C_A, constant (6.3.3-11); with a `table`, this and both slopes have no effect.
        normal_force_slope: Slope of the force across the body axis with the sine of the total angle of attack [1/rad].
        moment_slope: Slope of the static moment about the reference centre with that sine [1/rad].
        roll_damping: C_lp (6.3.3-13).
        pitch_damping: C_mq, and C_nr where `yaw_damping` is None.
        yaw_damping: C_nr.
        pitch_rate_damping: C_m_alphadot, on the rate of the angle of attack; None: no such moment.
        yaw_rate_damping: C_n_betadot, on the rate of the sideslip angle; None where `pitch_rate_damping` is.
        table: Coefficients by total angle of attack and roll; None: those above.
        products: The other elements of the inertia tensor, xy, xz and yz (minus the products of inertia as integrals)
            [kg m^2]; None: none, body axes are principal axes.
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
    yaw_damping: Component | None = None
    pitch_rate_damping: Component | None = None
    yaw_rate_damping: Component | None = None
    table: CapsuleTable | None = None
    products: Vec3 | None = None

    def angular_momentum(self, rate: Vec3) -> Vec3:
        """Of an angular rate, body axes [kg m^2/s]."""
        own = Vec3(self.inertia.x * rate.x, self.inertia.y * rate.y, self.inertia.z * rate.z)
        if self.products is None:
            return own
        xy, xz, yz = self.products.x, self.products.y, self.products.z
        return own + Vec3(xy * rate.y + xz * rate.z, xy * rate.x + yz * rate.z, xz * rate.x + yz * rate.y)

    def turned_by(self, moment: Vec3) -> Vec3:
        """Angular acceleration by a moment without rotation, body axes [rad/s^2]: the inverse of the tensor."""
        a, b, c = self.inertia.x, self.inertia.y, self.inertia.z
        if self.products is None:
            return Vec3(moment.x / a, moment.y / b, moment.z / c)
        xy, xz, yz = self.products.x, self.products.y, self.products.z
        rows = (
            Vec3(b * c - yz * yz, xz * yz - xy * c, xy * yz - b * xz),
            Vec3(xz * yz - xy * c, a * c - xz * xz, xy * xz - a * yz),
            Vec3(xy * yz - b * xz, xy * xz - a * yz, a * b - xy * xy),
        )
        determinant = a * rows[0].x + xy * rows[0].y + xz * rows[0].z
        return Vec3(*(dot(row, moment) / determinant for row in rows))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Canopies:
    """Equal canopies as particles with enclosed air.

    A canopy's aerodynamic moment about its reference point is carried by its riser as a couple: a force across the
    riser on the canopy, and its opposite on the capsule.

    Attributes:
        area: Reference area S of one canopy [m^2].
        length: Reference length l [m].
        speed: Reference speed V_o [m/s].
        dry_mass: m_d of one canopy [kg].
        enclosed_volume: V_ea [m^3]; the enclosed mass is the local air density times this.
        moment_slope: C_m_alpha about the reference point, by the sine of the angle of attack [1/rad]; negative where
            it restores. None: no such moment.
        pitch_damping: C_mq, on the riser's transverse rate times l/(2V); negative where it damps. None: no such moment.
    """

    area: Component
    length: Component
    speed: Component
    dry_mass: Component
    enclosed_volume: Component
    moment_slope: Component | None = None
    pitch_damping: Component | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Risers:
    """Tension-only elastic risers (6.3.3-1..3).

    Attributes:
        length: Unstretched [m].
        stiffness: k [N/m].
        damping: c [N s/m].
        engagement: Stretch over which the lines of a riser become taut one after another [m]. Beyond it the tension is
        that
            of the report, to the last bit; it must lie well below the stretch that a descent has (`engagement_length`).
    """

    length: Component
    stiffness: Component
    damping: Component
    engagement: Component


def engagement_length(load: float, stiffness: float, count: int) -> float:
    """Engagement of risers for a static load: a quarter of the stretch that it causes [m].

    Args:
        load: Weight carried by all risers [N].
        stiffness: Of one riser [N/m].
        count: Number of risers.
    """
    return 0.25 * load / (count * stiffness)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Breathing:
    """Shape eta of a canopy as a free oscillator that changes its axial coefficient by C_Aeta eta (6.3.2-27, -28).

    Attributes:
        stiffness: omega_n^2 [1/s^2].
        damping: d [1/s].
        axial_slope: C_Aeta.
    """

    stiffness: Component
    damping: Component
    axial_slope: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Cluster:
    """All numbers of the cluster.

    `axial` and `transverse` are the coefficients of the structure's terms, one for all canopies or (canopy, ...);
    `breathing` serves one that breathes. `position_scale` is of the instrument that sees the canopies: recorded over
    true distance between them and the capsule; None: one.

    The rest are constant errors of what was recorded, recorded less true by axis, as in `BIASES`; None: none.
    `wind_bias` is that of the wind; `canopy_position_bias` that of the distance of all canopies from the capsule;
    `capsule_attitude_bias` that of the attitude, a small turn about the body's axes across.
    """

    capsule: Capsule
    canopies: Canopies
    risers: Risers
    axial: tuple[Component, ...]
    transverse: tuple[Component, ...]
    gravity: Component = STANDARD_GRAVITY
    breathing: Breathing | None = None
    position_scale: Component | None = None
    wind_bias: tuple[Component, ...] | None = None
    canopy_position_bias: tuple[Component, ...] | None = None
    capsule_attitude_bias: tuple[Component, ...] | None = None


@dataclass(frozen=True)
class Structure:
    """Fixed structure of the model: terms, number of canopies, definition of the transverse rate.

    Attributes:
        axial: Terms of the axial coefficient (`bayeschute.aero.terms`).
        transverse: Terms of the transverse coefficient.
        canopies: Number of canopies.
        rate: ``"riser"`` (rate of the riser alone) or ``"airflow"`` (of the wind direction relative to the riser).
        force: A user-defined force law that replaces the terms (`bayeschute.dynamics.forces`), or None.
            `axial` and `transverse` then only name the law's coefficients.
        breathing: Whether the canopies breathe: the state grows by eta and its rate for each.
        saturation: Total angle of attack at which its powers in terms level off [rad]; None: nowhere.
    """

    axial: tuple[str, ...]
    transverse: tuple[str, ...]
    canopies: int = 2
    rate: str = field(default="riser")
    force: Callable[..., Vec3] | None = None
    breathing: bool = False
    saturation: float | None = None
