"""`Motion`: angles, airflow, tensions and coefficients along a flight's record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import xarray as xr

from bayeschute.api.flight import Flight

if TYPE_CHECKING:
    from bayeschute.reduced.cluster_modes import ClusterModes


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """Motion and forces along a flight's record.

    Attributes:
        flight: The flight.
        data: Angles, airflow, tensions and coefficients over time; units are in the attributes.

    Example:
        >>> motion = bc.reconstruct(bc.Study.example().flights["cdt-3-12"])
        >>> motion["C_A"].dims
        ('time', 'canopy')
    """

    flight: Flight
    data: xr.Dataset

    def __getitem__(self, name: str) -> xr.DataArray:
        """A quantity over time."""
        return self.data[name]

    def modes(self, length: float = 15.0, seed: int = 0) -> ClusterModes:
        """Modes of motion by window (pendulum, glide, flyout, maypole), and the coefficients from each stretch.

        Args:
            length: Of the windows [s].
            seed: Of the draws of coefficients.

        Returns:
            Labels by window, stretches of one label with frequency, damping and coefficients, and the breathing.
        """
        from bayeschute.reduced.cluster_modes import cluster_modes
        from bayeschute.study.assembly.assemble import geometry

        assert self.flight.vehicle is not None
        vehicle = geometry(self.flight.vehicle, self.flight.spec.capsule_mass)
        return cluster_modes(self.flight.record, self.data, vehicle, length=length, seed=seed)

    def __repr__(self) -> str:
        """Flight and quantities."""
        return f"Motion of {self.flight.name}: {', '.join(map(str, self.data.data_vars))}"

    def _repr_html_(self) -> str:
        """As xarray shows it."""
        return str(self.data._repr_html_())
