"""Motion of a flight: its modes are those of its own vehicle and payload."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import xarray as xr

from bayeschute.api.views.flight_motion import Motion
from bayeschute.reduced import cluster_modes
from bayeschute.study.assembly import assemble


def test_modes_are_of_the_flight_s_vehicle_with_its_own_payload(monkeypatch):
    asked = []
    monkeypatch.setattr(assemble, "geometry", lambda vehicle, mass: (vehicle, mass))
    monkeypatch.setattr(cluster_modes, "cluster_modes", lambda *given, **named: asked.append((given, named)))
    data = xr.Dataset({"C_A": ("time", np.arange(3.0)), "tension": ("time", np.ones(3))})
    flight = SimpleNamespace(
        name="a", vehicle="a cluster", record="its record", spec=SimpleNamespace(capsule_mass=9100.0)
    )
    motion = Motion(flight, data)
    motion.modes(10.0, seed=4)
    assert asked == [(("its record", data, ("a cluster", 9100.0)), {"length": 10.0, "seed": 4})]
    assert repr(motion) == "Motion of a: C_A, tension" and motion["C_A"].identical(data["C_A"])
