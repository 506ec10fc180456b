"""Evidence of random numbers, for inverses that have to hold whatever a record says."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bayeschute.records.plausibility.evidence import CHANNELS, Evidence, Nominal

SAMPLES = 24
FIELDS = (*CHANNELS, "profile", "shear")


def vehicle() -> Nominal:
    """Numbers of which no two are alike."""
    return Nominal(
        mass=900.0, attach_b=np.array([1.5, 0.1, -0.2]), inertia=np.array([700.0, 800.0, 850.0]), capsule_length=3.0,
        capsule_area=7.5, capsule_drag=0.9, canopies=2, area=120.0, diameter=12.5, dry_mass=40.0, volume=260.0,
        riser_length=20.0, stiffness=4e4,
    )  # fmt: skip


def evidence(**changes: Any) -> Evidence:
    """All channels, none zero, quaternions of norm one and without jumps."""
    rng = np.random.default_rng(8)
    time = 0.1 * np.arange(SAMPLES)
    x, y, z, w = Rotation.from_rotvec(np.outer(time, [0.3, -0.5, 0.7]) + [0.4, 0.9, -0.3]).as_quat().T
    made: dict[str, Any] = {
        name: rng.uniform(1.0, 5.0, (SAMPLES, 3))
        for name in ("position", "velocity", "rate", "force", "wind", "profile", "shear")
    }
    made |= {name: rng.uniform(1.0, 5.0, (SAMPLES, 2, 3)) for name in ("canopies", "canopy_velocity")}
    made |= {name: rng.uniform(1.0, 5.0, SAMPLES) for name in ("density", "pressure", "temperature", "descent_rate")}
    made |= {"tension": rng.uniform(1.0, 5.0, (SAMPLES, 2)), "altitude": rng.uniform(500.0, 900.0, SAMPLES)}
    return Evidence(
        **{"time": time, "attitude": np.stack([w, x, y, z], axis=1), "vehicle": vehicle(), **made, **changes}
    )


def changed_channels(before: Evidence, after: Evidence) -> set[str]:
    """Channels whose values differ."""
    pairs = {name: (getattr(before, name), getattr(after, name)) for name in FIELDS}
    return {name for name, (a, b) in pairs.items() if a is not b and not np.allclose(a, b, rtol=1e-12, atol=0.0)}


def alike(one: Evidence, other: Evidence) -> bool:
    """Whether all channels agree, quaternions but for their sign."""
    for name in FIELDS:
        a, b = getattr(one, name), getattr(other, name)
        if (a is None) != (b is None):
            return False
        if a is not None and not np.allclose(a, b if name != "attitude" else np.sign(np.sum(a[0] * b[0])) * b):
            return False
    return True
