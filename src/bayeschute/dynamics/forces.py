"""User-defined laws of the canopy force in place of the equivariant terms: `Structure(..., force=law)`.

A force law is a function of the airflow, the risers, the cluster and the air that returns the force on every canopy
[N], NED components (canopy, ...). It takes its coefficients from `Cluster.axial` and `Cluster.transverse`, so that
they can be batched, differentiated and identified by name like those of the terms. The equations of motion are the
same.
"""

from __future__ import annotations

from bayeschute.aero.airflow import CanopyFlow
from bayeschute.aero.polar import PitchPlane, drag_coefficient, polar_coefficient
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import Air, RiserGeometry
from bayeschute.dynamics.parameters import Cluster


def drag(flow: CanopyFlow, geo: RiserGeometry, model: Cluster, air: Air) -> Vec3:
    """Drag opposite to the airflow, in any direction; ``axial = (C_D,)``."""
    (C_D,) = model.axial
    return drag_coefficient(flow, C_D * air.axial_factor) * (flow.q * model.canopies.area)


def constant_polar(flow: CanopyFlow, geo: RiserGeometry, model: Cluster, air: Air) -> Vec3:
    """Constant coefficients along the wind frame; ``axial = (C_A,)``, ``transverse = (C_Y, C_N)`` (6.3.3-5)."""
    (C_A,), (C_Y, C_N) = model.axial, model.transverse
    return polar_coefficient(flow, C_A * air.axial_factor, C_Y, C_N) * (flow.q * model.canopies.area)


def pitch_plane(flow: CanopyFlow, geo: RiserGeometry, model: Cluster, air: Air) -> Vec3:
    """The set of Table 7.1-2; ``axial = (C_A0, C_Aalpha, alpha_0)``, ``transverse = (C_Nalpha, C_Nalphadot)``."""
    canopies, c = model.canopies, PitchPlane(*model.axial, *model.transverse)
    C_A, C_N = c.axial(flow) * air.axial_factor, c.normal(flow, canopies.length, canopies.speed)
    return polar_coefficient(flow, C_A, 0.0, C_N) * (flow.q * canopies.area)
