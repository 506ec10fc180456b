"""Numbers of the page on evidence that come from stored results, against these results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
STORED = ROOT / "models/reference/calibration"
TEXT = " ".join((ROOT / "docs/evidence.md").read_text(encoding="utf-8").split())


def _held(name: str) -> dict[str, Any]:
    return json.loads((STORED / f"{name}.json").read_text(encoding="utf-8"))


def _percent(share: float) -> str:
    return f"{100 * share:.0f}"


def _range(shares: list[float]) -> str:
    return f"{_percent(min(shares))} to {_percent(max(shares))} %"


def _unseen(held: dict[str, Any]) -> dict[str, float]:
    """Shares of the truth in the bands of flights that were not fitted, by quantity."""
    return {k.split("/")[1]: v for k, v in held["coverage"].items() if k.startswith("cdt-3-12/")}


def test_bands_and_intervals_of_the_default_study():
    held = _held("latent.none")
    bands, aerodynamic = _unseen(held), [n for n in held["coverage"] if n.startswith(("axial", "transverse"))]
    names = {"swing_angle": "swing angle", "descent_rate": "descent rate", "flyout_angle": "flyout angle"}
    by_quantity = ", ".join(f"{_percent(bands[k])} % ({words})" for k, words in names.items())
    assert f"In {held['replicates']} replicates of the default study" in TEXT
    assert f"nominal 90 % bands of the unseen flight held {by_quantity} of the truth" in TEXT
    errors = [100 * held["standard_error"][n] for n in aerodynamic]
    spread = f"{min(errors):.0f} to {max(errors):.0f} %"
    shares = _range([held["coverage"][n] for n in aerodynamic])
    assert len(aerodynamic) == 11 and not held["failed"]
    assert f"intervals of its eleven aerodynamic parameters {shares} (standard error {spread}); none failed" in TEXT


def test_bands_under_disturbances():
    found = {path.stem: _held(path.stem) for path in STORED.glob("latent.*.json") if path.stem != "latent.none"}
    wind = found["latent.wind-profile"]
    others = [
        share
        for name, held in found.items()
        for quantity, share in _unseen(held).items()
        if not (held is wind and "descent_rate" in quantity)
    ]
    rate = "cdt-3-12/descent_rate"
    exception = f"{_percent(wind['coverage'][rate])} ± {_percent(wind['standard_error'][rate])} %"
    assert f"held {_range(others)} of the truth, but descent rates under a wrong wind profile {exception}" in TEXT
    flown = sum(held["replicates"] + len(held["failed"]) for held in found.values())
    assert sum(len(held["failed"]) for held in found.values()) == 1 and f"One of these {flown} flights" in TEXT


@pytest.mark.parametrize(
    ("noise", "words"),
    [("sandwich", "classical output error with the sandwich correction"), ("ar1", "AR(1)"), ("white", "white noise")],
)
def test_bands_of_other_treatments_of_noise(noise, words):
    assert f"{_range(list(_unseen(_held(f'{noise}.none')).values()))} ({words})" in TEXT


def test_ranks():
    count = {kind: _held(f"ranks.{kind}")["replicates"] for kind in ("dumbbell", "cluster")}
    assert f"Ranks of {count['dumbbell']} dumbbells and of {count['cluster']} clusters with latent wind" in TEXT
