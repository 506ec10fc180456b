"""Tables of a vehicle file (`models/vehicles/*.toml`): bodies, canopies, risers and aerodynamics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from bayeschute.aero.coefficient import coefficient_names
from bayeschute.aero.term_names import check_axial, check_transverse, rate_factors
from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from bayeschute.study.schema.capsule_schema import CapsuleAeroTable
from bayeschute.study.schema.quantities import (
    Area,
    Bounds,
    Damping,
    Frequency,
    Inertia,
    InertiaProduct,
    Length,
    Mass,
    Number,
    PositiveLength,
    PositiveSpeed,
    Stiffness,
    Text,
    Volume,
    each,
    number,
    whole,
)
from bayeschute.study.schema.reading.strict import Strict, refuse, rule

Rotation = Literal["riser", "airflow"]
Frame = Literal["structural", "body"]
_COEFFICIENTS = ("axial_force", "normal_force_slope", "pitch_moment_slope")
_AXIAL = each(check_axial, "at least one term of the axial coefficient, such as '1' or 'alpha^2'", none="no term")
_TRANSVERSE = each(check_transverse, "terms of the transverse coefficient, such as 'e' or 'e*alpha^2'")


def from_centre_of_mass(
    place: Sequence[float], centre: Sequence[float], frame: Frame | None
) -> tuple[float, float, float]:
    """A place from the centre of mass in body axes [m]: x and z of the structural frame reverse (6.3.3-14b, -20b).

    Args:
        place: In the frame (3,) [m].
        centre: The centre of mass, likewise.
        frame: ``structural`` (x aft, z reversed; also None) or ``body`` (x towards the risers, as records are turned).
    """
    x, y, z = (float(a - b) for a, b in zip(place, centre, strict=True))
    return (x, y, z) if frame == "body" else (-x, y, -z)


class CapsuleTable(Strict):
    """The payload: a rigid body.

    Attributes:
        mass: [kg].
        inertia: Moments about the centre of mass, body axes [kg m^2].
        inertia_products: The other elements of the inertia tensor in body axes: xy, xz, yz [kg m^2]; None: zero.
        reference_area: [m^2].
        reference_length: [m].
        points_in: Frame of the next three points: ``body``, or the structural one (x aft, z reversed), also where None.
        centre_of_mass: [m].
        attach_point: Where the risers end [m].
        reference_centre: Moment reference point of the coefficients [m].
        axial_force: C_A in the body frame (6.3.3-11).
        normal_force_slope: [1/rad].
        pitch_moment_slope: [1/rad].
        table: Takes the place of these three: coefficients by total angle of attack and roll.
        roll_damping: C_lp (6.3.3-13).
        pitch_damping: C_mq, and C_nr where no yaw_damping is given (6.3.3-13).
        yaw_damping: C_nr.
        pitch_rate_damping: C_m_alphadot (6.3.3-13); None: none.
        yaw_rate_damping: C_n_betadot (6.3.3-13); None: none.
    """

    mass: Mass
    inertia: tuple[Inertia, Inertia, Inertia]
    inertia_products: tuple[InertiaProduct, InertiaProduct, InertiaProduct] | None = None
    reference_area: Area
    reference_length: PositiveLength
    points_in: Frame | None = None
    centre_of_mass: tuple[Length, Length, Length]
    attach_point: tuple[Length, Length, Length]
    reference_centre: tuple[Length, Length, Length]
    axial_force: Number | None = None
    normal_force_slope: Number | None = None
    pitch_moment_slope: Number | None = None
    table: CapsuleAeroTable | None = None
    roll_damping: Number
    pitch_damping: Number
    yaw_damping: Number | None = None
    pitch_rate_damping: Number | None = None
    yaw_rate_damping: Number | None = None

    @rule
    def _is_a_body(self) -> None:
        xy, xz, yz = self.inertia_products or (0.0, 0.0, 0.0)
        x, y, z = self.inertia
        least = float(np.linalg.eigvalsh([[x, xy, xz], [xy, y, yz], [xz, yz, z]])[0])
        if least <= 0.0:
            do = "Give elements of the tensor (minus the integrals of products), about the centre of mass."
            refuse("an inertia tensor that is positive definite", f"a principal moment of {least:.4g} kg m^2", do)

    @rule
    def _has_coefficients(self) -> None:
        present = [name for name in _COEFFICIENTS if getattr(self, name) is not None]
        if self.table is None and len(present) < len(_COEFFICIENTS):
            missing = ", ".join(name for name in _COEFFICIENTS if name not in present)
            refuse(f"{', '.join(_COEFFICIENTS)}, or a table [capsule.table]", f"no {missing}", "Add it.")
        if self.table is not None and present:
            refuse(
                "coefficients or a table [capsule.table]",
                f"both a table and {', '.join(present)}",
                "Remove one of them.",
            )


class BreathingTable(Strict):
    """Shape eta of a canopy, a free oscillator that changes its axial coefficient (6.3.2-27, -28).

    Attributes:
        frequency: Undamped [Hz].
        damping_ratio: Share of critical damping [1].
        axial_slope: C_Aeta [1].
    """

    frequency: Frequency
    damping_ratio: Annotated[float, number(Bounds(least=0.0, most=1.0))]
    axial_slope: Number


class CanopiesTable(Strict):
    """Equal canopies.

    Attributes:
        number: How many.
        reference_length: l [m].
        reference_area: S of one canopy [m^2].
        reference_speed: V_o [m/s].
        dry_mass: m_d of one canopy [kg].
        enclosed_volume: V_ea of one canopy [m^3].
        pitch_moment_slope: C_m_alpha of a canopy's moment about its reference point, by the sine of the angle of attack
            [1/rad]; negative where it restores.
        pitch_damping: C_mq of a canopy [1]; negative where it damps.
        breathing: Makes every canopy's shape part of the state; None: canopies keep their shape.
    """

    number: Annotated[int, whole(1, 12)]
    reference_length: PositiveLength
    reference_area: Area
    reference_speed: PositiveSpeed
    dry_mass: Mass
    enclosed_volume: Volume
    pitch_moment_slope: Number = 0.0
    pitch_damping: Number = 0.0
    breathing: BreathingTable | None = None


class RisersTable(Strict):
    """Risers.

    Attributes:
        length: Unstretched [m].
        stiffness: [N/m].
        damping: [N s/m].
        engagement: Stretch over which a riser takes hold as it comes taut [m]; None: a quarter of what the capsule's
            weight stretches it.
    """

    length: PositiveLength
    stiffness: Stiffness
    damping: Damping
    engagement: PositiveLength | None = None


class AeroTable(Strict):
    """Aerodynamics of a canopy, used to simulate virtual drops and never by an identification.

    Attributes:
        source: Where the numbers come from.
        rate: Rate in the damping terms: the riser's direction or the wind's relative to it.
        axial: Coefficient by term of the axial coefficient.
        transverse: Coefficient by term of the transverse coefficient.
    """

    source: Text
    rate: Rotation
    axial: Annotated[dict[str, Number], _AXIAL]
    transverse: Annotated[dict[str, Number], _TRANSVERSE]

    def coefficients(self) -> dict[str, float]:
        """All coefficients by the name of their parameter, axial ones first."""
        return dict(zip(coefficient_names(self), (*self.axial.values(), *self.transverse.values()), strict=True))

    @rule
    def _is_linear_in_the_rate(self) -> None:
        twice = [t for t in (*self.axial, *self.transverse) if rate_factors(t) > 1]
        if self.rate == "airflow" and twice:
            wanted = (
                "terms that hold the rate once where rate is 'airflow': the canopy's acceleration is solved from them"
            )
            refuse(wanted, ", ".join(repr(t) for t in twice))


NOT_FLOWN = AeroTable(source="none: no virtual drop is flown", rate="riser", axial={"1": 1.0}, transverse={"e": 0.0})
"""Stands for the table where a vehicle file has none; virtual drops of such a vehicle are refused."""


class Vehicle(Strict):
    """A vehicle file.

    Attributes:
        name: For the report.
        capsule: The payload.
        canopies: The canopies.
        risers: The lines between.
        aero: The aerodynamics of virtual drops; without it none can be flown.
    """

    name: Text
    capsule: CapsuleTable
    canopies: CanopiesTable
    risers: RisersTable
    aero: AeroTable = NOT_FLOWN

    @rule
    def _is_well_posed(self) -> None:
        """The airflow rate acts as an apparent mass rho S l C_rate/4; with the canopy's own it must stay above zero."""
        k, damping = self.canopies, self.aero.transverse.get("rate", 0.0)
        inertia = k.dry_mass + SEA_LEVEL_DENSITY * k.enclosed_volume
        apparent = 0.25 * SEA_LEVEL_DENSITY * k.reference_area * k.reference_length * damping
        if self.aero.rate == "airflow" and inertia + apparent <= 0.0:
            wanted = f"a coefficient of 'rate' whose apparent mass stays above -{inertia:.0f} kg, or rate = 'riser'"
            refuse(wanted, f"{damping:g}, which gives {apparent:.0f} kg")

    @rule
    def _hangs_taut(self) -> None:
        """Risers are fully engaged in the static equilibrium of the hanging capsule."""
        stretch = self.capsule.mass * STANDARD_GRAVITY / (self.canopies.number * self.risers.stiffness)
        engagement = self.risers.engagement
        if engagement is not None and engagement > stretch:
            wanted = f"an engagement of risers up to {stretch:.3g} m, to which the capsule's weight stretches them"
            refuse(wanted, f"{engagement:.3g} m")
