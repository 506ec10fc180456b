"""The shipped calibration: campaigns of the default study, stored under models/reference, and docs/calibration.md.

Every campaign is one call of ``bayeschute calibrate``; finished replicates are kept, so the same command goes on where
it was stopped. ``--page`` writes the page again from what is stored, without flying anything.

Workers stay for all campaigns, and so does what they compiled. More replicates of the campaigns with a disturbance are
added to those that are there:

    python benchmarks/calibration.py [--workers 2] [--only latent.none white.none] [--few 20] [--page]
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from time import perf_counter
from typing import Any

from bayeschute.calibration.page import page
from bayeschute.calibration.workers import kept_open

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
STORED = ROOT / "models" / "reference" / "calibration"
PAGE = ROOT / "docs" / "calibration.md"
COMMAND = "python benchmarks/calibration.py"
FEW = 20
MANY = 200
CAMPAIGNS = (  # noise model, disturbance, replicates
    ("latent", "none", MANY),
    ("ar1", "none", FEW),
    ("sandwich", "none", FEW),
    ("white", "none", FEW),
    ("latent", "strong-gusts", FEW),
    ("latent", "short-gusts", FEW),
    ("latent", "long-gusts", FEW),
    ("latent", "breathing", FEW),
    ("latent", "wind-profile", FEW),
    ("latent", "mass", FEW),
    ("latent", "form", FEW),
    ("latent", "dropouts", FEW),
)


def stored() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Results of campaigns, in the order of `CAMPAIGNS`, and of rank tests."""
    files = [STORED / f"{noise}.{disturbance}.json" for noise, disturbance, _ in CAMPAIGNS]
    made = [json.loads(f.read_text(encoding="utf-8")) for f in files if f.exists()]
    return made, [json.loads(f.read_text(encoding="utf-8")) for f in sorted(STORED.glob("ranks.*.json"))]


def write_page() -> None:
    """Write docs/calibration.md from what is stored."""
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(*stored(), COMMAND), encoding="utf-8")


def fly(noise: str, disturbance: str, replicates: int, out: Path, address: str | None) -> None:
    """Fly a campaign, store it, and write the page."""
    from bayeschute.study.calibrate import calibrate

    name, began = f"{noise}.{disturbance}", perf_counter()

    def tell(share: float, words: str) -> None:
        print(f"\r{name}: {words}   ", end="", flush=True)

    calibrate(STUDY, out, replicates, disturbance, noise, address=address, progress=tell)
    STORED.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(out / f"{name}.json", STORED / f"{name}.json")
    write_page()
    print(f"\n{name}: {(perf_counter() - began) / 60.0:.1f} min")


def main() -> None:
    """Fly what is asked for, store it, and write the page after every campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [f"{noise}.{disturbance}" for noise, disturbance, _ in CAMPAIGNS]
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--dask", metavar="ADDRESS", help="Dask scheduler, in place of --workers")
    parser.add_argument("--few", type=int, default=FEW, metavar="N", help=f"replicates of all but the first ({FEW})")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NOISE.DISTURBANCE")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "calibration" / "cdt-3-11", help="for rows")
    parser.add_argument("--page", action="store_true", help="only write the page")
    given = parser.parse_args()
    if not given.page:
        with kept_open(given.workers, given.dask) as address:
            for noise, disturbance, replicates in CAMPAIGNS:
                if f"{noise}.{disturbance}" in given.only:
                    fly(noise, disturbance, given.few if replicates == FEW else replicates, given.out, address)
    write_page()


if __name__ == "__main__":
    main()
