"""Published sets as what the simulator flies: coefficients of the planar dumbbell, force laws of the cluster."""

from __future__ import annotations

from dataclasses import dataclass

from bayeschute.aero.polar import polar_coefficient
from bayeschute.aero.polar_terms import polar_sum
from bayeschute.aero.published import PublishedSet
from bayeschute.air.airflow import CanopyFlow
from bayeschute.air.vector import Vec3
from bayeschute.dynamics.cluster import Air, RiserGeometry
from bayeschute.dynamics.parameters import Cluster
from bayeschute.dynamics.planar import PlanarAero
from bayeschute.errors import Fault, InputError


@dataclass(frozen=True)
class PolarLaw:
    """A law of the canopies' force in the polar form: `Structure(axial, transverse, n, force=law)`.

    The cluster's `axial` are the coefficients of `axial`, its `transverse` those of `side`, then of `normal`.

    Attributes:
        axial: Terms of C_A (`bayeschute.aero.polar_terms`).
        side: Terms of C_Y.
        normal: Terms of C_N.
    """

    axial: tuple[str, ...]
    side: tuple[str, ...]
    normal: tuple[str, ...]

    def __call__(self, flow: CanopyFlow, geo: RiserGeometry, model: Cluster, air: Air) -> Vec3:
        """Force on every canopy [N], NED (6.3.3-5)."""
        n = len(self.side)
        C_A = polar_sum(self.axial, model.axial, flow) * air.axial_factor
        C_Y = polar_sum(self.side, model.transverse[:n], flow)
        C_N = polar_sum(self.normal, model.transverse[n:], flow)
        return polar_coefficient(flow, C_A, C_Y, C_N) * (flow.q * model.canopies.area)


def _wanted(published: PublishedSet, form: str) -> None:
    if published.form != form:
        raise InputError(Fault(published.title, f"a {published.form} set", f"a {form} set"))


def planar_aero(published: PublishedSet) -> PlanarAero:
    """Coefficients of the dumbbell from a planar set.

    Raises:
        InputError: If the set is not planar.
    """
    _wanted(published, "planar")
    v = published.estimates()
    return PlanarAero(v["C_A0"], v["C_Aalpha"], v["alpha_0"], v["C_Nalpha"], v["C_Nalphadot"])


def polar_law(published: PublishedSet) -> tuple[PolarLaw, tuple[float, ...], tuple[float, ...]]:
    """Force law of the cluster with its axial and transverse coefficients, from a polar set.

    Raises:
        InputError: If the set is not polar.
    """
    _wanted(published, "polar")
    axial, side, normal = (published.of(c) for c in ("C_A", "C_Y", "C_N"))
    return PolarLaw(tuple(axial), tuple(side), tuple(normal)), tuple(axial.values()), (*side.values(), *normal.values())
