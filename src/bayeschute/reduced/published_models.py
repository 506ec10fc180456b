"""Published coefficient sets converted to the planar dumbbell."""

from __future__ import annotations

from bayeschute.aero.published import PublishedSet
from bayeschute.core.errors import Fault, InputError
from bayeschute.reduced.planar import PlanarAero


def planar_aero(published: PublishedSet) -> PlanarAero:
    """Coefficients of the dumbbell from a planar set.

    Raises:
        InputError: If the set is not planar.
    """
    if published.form != "planar":
        raise InputError(Fault(published.title, f"a {published.form} set", "a planar set"))
    v = published.estimates()
    return PlanarAero(v["C_A0"], v["C_Aalpha"], v["alpha_0"], v["C_Nalpha"], v["C_Nalphadot"])
