"""The two parameter sets that every check case is run with, and what follows from them in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.units import to_si
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.parameters import Canopies, Capsule, Cluster, Risers, engagement_length

Array = NDArray[np.float64]

FOOT = to_si("1 ft", "m")
POUND = to_si("1 lbf", "N")
SLUG = to_si("1 slug", "kg")
DEGREE = to_si("1 deg", "rad")


@dataclass(frozen=True)
class ParameterSet:
    """A capsule, taken as a particle, under two equal canopies; SI.

    Attributes:
        name: As in the table of results.
        capsule_mass: m_L [kg].
        canopy_mass: m_c of one canopy with its enclosed air [kg].
        dry_mass: m_d of one canopy [kg].
        length: L, riser length under the initial load [m].
        area: S of one canopy [m^2].
        enclosed_volume: V_ea [m^3].
        gravity: g [m/s^2].
        C_A: Axial coefficient of all cases that name none.
        stiffness: k of one riser [N/m].
        damping: c of one riser [N s/m].
        reference_length: l [m].
        reference_speed: V_o [m/s].
    """

    name: str
    capsule_mass: float
    canopy_mass: float
    dry_mass: float
    length: float
    area: float
    enclosed_volume: float = 140164.0 * FOOT**3
    gravity: float = 32.174 * FOOT
    C_A: float = 0.927
    stiffness: float = 15000.0 * POUND / FOOT
    damping: float = 10000.0 * POUND / FOOT
    reference_length: float = 116.0 * FOOT
    reference_speed: float = 32.0 * FOOT

    @property
    def density(self) -> float:
        """Density that the enclosed air follows from [kg/m^3]."""
        return (self.canopy_mass - self.dry_mass) / self.enclosed_volume

    @property
    def dry_weight(self) -> float:
        """W_c of one canopy [N]."""
        return self.dry_mass * self.gravity

    @property
    def weight(self) -> float:
        """W of everything but the enclosed air [N]."""
        return self.capsule_mass * self.gravity + 2.0 * self.dry_weight

    @property
    def mass(self) -> float:
        """M of everything [kg]."""
        return self.capsule_mass + 2.0 * self.canopy_mass

    @property
    def fall(self) -> float:
        """Acceleration without drag, g' = W/M [m/s^2]."""
        return self.weight / self.mass

    @property
    def kappa(self) -> float:
        """Deceleration over speed squared, of drag with C_A on both canopies [1/m]."""
        return self.density * self.area * self.C_A / self.mass

    @property
    def terminal_speed(self) -> float:
        """V_t = sqrt(g'/kappa) [m/s]."""
        return float(np.sqrt(self.fall / self.kappa))

    @property
    def load(self) -> float:
        """Dynamic pressure times area at which C_A on both canopies carries the weight [N]."""
        return self.weight / (2.0 * self.C_A)

    @property
    def pendulum_rate(self) -> float:
        """w0 of the pendulum without aerodynamic stiffness, squared (g - W_c/m_c)/L [rad/s]."""
        return float(np.sqrt((self.gravity - self.dry_weight / self.canopy_mass) / self.length))

    def tension(self, lean: float, turning: float, pull: float) -> float:
        """Tension of each of two equally leaning rigid risers [N].

        Args:
            lean: Angle of both risers off the vertical, in one direction [rad].
            turning: Rate at which their direction turns [1/s].
            pull: Force of each canopy along its riser, weight not counted [N].
        """
        # a_C - a_L = -L n_dot^2 along n, with m_c a_C = pull - T - W_c cos and m_L a_L = 2 T - W_L cos.
        apart = (pull - self.dry_weight * np.cos(lean)) / self.canopy_mass + self.gravity * np.cos(lean)
        return float((apart + self.length * turning**2) / (1.0 / self.canopy_mass + 2.0 / self.capsule_mass))

    def cluster(
        self,
        axial: tuple[float, ...],
        transverse: tuple[float, ...],
        tension: float,
        stiffer: float = 1.0,
        capsule: Capsule | None = None,
    ) -> Cluster:
        """The numbers that the simulator needs.

        Args:
            axial: Coefficients of the force law.
            transverse: Likewise.
            tension: Of each riser at the start [N]; sets the unstretched length.
            stiffer: Factor on k and c.
            capsule: Replaces the particle.
        """
        canopies = Canopies(self.area, self.reference_length, self.reference_speed, self.dry_mass, self.enclosed_volume)
        k = self.stiffness * stiffer
        engagement = engagement_length(self.capsule_mass * self.gravity, k, 2)
        risers = Risers(self.length - tension / k, k, self.damping * stiffer, engagement)
        particle = self.particle() if capsule is None else capsule
        return Cluster(particle, canopies, risers, axial, transverse, self.gravity)

    def particle(self) -> Capsule:
        """A capsule without aerodynamics whose risers meet at its centre of mass."""
        zero = Vec3(0.0, 0.0, 0.0)
        inertia = Vec3(25e3, 22e3, 20e3)
        return Capsule(self.capsule_mass, inertia, zero, zero, 20.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0)


T71 = ParameterSet(
    "T71",
    capsule_mass=21906.0 / 32.174 * SLUG,
    canopy_mass=307.0 * SLUG,
    dry_mass=328.0 / 32.174 * SLUG,
    length=235.0 * FOOT,
    area=10563.0 * FOOT**2,
)
T61 = ParameterSet(
    "T61",
    capsule_mass=648.44 * SLUG,
    canopy_mass=307.0 * SLUG,
    dry_mass=10.22 * SLUG,
    length=234.0 * FOOT,
    area=10568.3 * FOOT**2,
)
SETS = (T71, T61)
