"""Extrapolation: predicted flights that swing further than any that was fitted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

_FLOWN, _FAR = 0.995, 0.05  # quantile of the fitted swing that counts as its most; share beyond it that is told


def extrapolated(run: Path) -> tuple[str, ...]:
    """A sentence for each flight whose bands rest on the form of the terms where no fitted flight has been.

    Args:
        run: Folder of the run; without ``predictions.nc``, or without swing angles, there are none.
    """
    if not (run / "predictions.nc").is_file():
        return ()
    with xr.open_datatree(run / "predictions.nc", engine="h5netcdf") as tree:
        return beyond({name: tree[name].to_dataset() for name in tree.children})


def beyond(flights: Mapping[str, xr.Dataset]) -> tuple[str, ...]:
    """Likewise, from the bands of the flights by name.

    Args:
        flights: With ``swing_angle_draws`` (draw, time) [rad], NaN where a simulation failed, and their ``role``.
    """
    swings = {
        (name, str(one.attrs.get("role"))): one["swing_angle_draws"].values
        for name, one in flights.items()
        if "swing_angle_draws" in one
    }
    fitted = [angles for (_, role), angles in swings.items() if role == "identify" and np.isfinite(angles).any()]
    if not fitted:
        return ()
    most, said = max(float(np.nanquantile(angles, _FLOWN)) for angles in fitted), []
    for (name, role), angles in swings.items():
        known = angles[np.isfinite(angles)]
        share = float(np.mean(known > most)) if role == "predict" and known.size else 0.0
        if share >= _FAR:
            said.append(
                f"{name} swings further than {np.degrees(most):.3g} deg, the most that was fitted, in "
                f"{100.0 * share:.0f} % of its predicted samples: there its bands rest on the form of the terms alone."
            )
    return tuple(said)
