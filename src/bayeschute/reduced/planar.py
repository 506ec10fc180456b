"""Aerodynamics of canopies that move in one plane (report 6.3.1-10..12)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import jax
import jax.numpy as jnp

from bayeschute.core.vectors import Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PlanarAero:
    """Coefficients of one canopy by its angle of attack (6.3.1-10..12).

    The report draws a statically stable design, too (figure 6.3.1-2), but prints no formula. Ours has the normal curve
    read from the trim angle outward, C_N(abs(alpha) + alpha_0), so that alpha = 0 is its only equilibrium, and an axial
    curve of the same curvature that starts at C_A0: stability costs drag.

    Attributes:
        C_A0: Axial coefficient at the trim angle (of the stable design: at zero).
        C_Aalpha: Its slope at alpha_0 [1/rad].
        alpha_0: Trim angle [rad], > 0.
        C_Nalpha: Slope of the normal coefficient at the trim angle [1/rad].
        C_Nalphadot: Damping: of theta' [s/rad] with rate ``"pivot"`` (6.3.1-12), or of the riser's transverse rate
            times l/(2 V) [1/rad] with rate ``"riser"``, as in the cluster. Negative drives the pendulum.
        statically_stable: Which of the two designs.
        rate: ``"pivot"`` or ``"riser"``.
    """

    C_A0: Component
    C_Aalpha: Component
    alpha_0: Component
    C_Nalpha: Component
    C_Nalphadot: Component
    statically_stable: bool = field(default=False, metadata={"static": True})
    rate: Literal["pivot", "riser"] = field(default="pivot", metadata={"static": True})

    def trim(self) -> Component:
        """Stable equilibrium angle of attack [rad]."""
        return 0.0 * self.alpha_0 if self.statically_stable else self.alpha_0

    def axial(self, alpha: Component) -> Component:
        """C_A (6.3.1-10)."""
        a = self.alpha_0
        return self.C_A0 + 0.5 * self.C_Aalpha * a * ((alpha / a) ** 2 - (0.0 if self.statically_stable else 1.0))

    def normal(self, alpha: Component) -> Component:
        """Static C_N (6.3.1-11), odd in alpha."""
        slope, size = self.C_Nalpha / (2.0 * self.alpha_0**2), jnp.abs(alpha)
        if not self.statically_stable:
            return slope * alpha * (alpha * alpha - self.alpha_0**2)
        return slope * alpha * (size + self.alpha_0) * (size + 2.0 * self.alpha_0)
