"""The shipped calibration: campaigns of the default study, stored under models/reference, and docs/calibration.md.

Every campaign is one call of ``bayeschute calibrate``; finished replicates are kept, so the same command goes on where
it was stopped. ``--page`` writes the page again from what is stored, without flying anything.

    python benchmarks/calibration.py [--workers 2] [--only latent.none white.none] [--page]
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from time import perf_counter
from typing import Any

from bayeschute.calibration.page import page

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
STORED = ROOT / "models" / "reference" / "calibration"
PAGE = ROOT / "docs" / "calibration.md"
COMMAND = "python benchmarks/calibration.py"
FEW = 20
CAMPAIGNS = (  # noise model, disturbance, replicates
    ("latent", "none", 100),
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


def main() -> None:
    """Fly what is asked for, store it, and write the page after every campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [f"{noise}.{disturbance}" for noise, disturbance, _ in CAMPAIGNS]
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NOISE.DISTURBANCE")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "calibration" / "cdt-3-11", help="for rows")
    parser.add_argument("--page", action="store_true", help="only write the page")
    given = parser.parse_args()
    for noise, disturbance, replicates in () if given.page else CAMPAIGNS:
        name = f"{noise}.{disturbance}"
        if name not in given.only:
            continue
        from bayeschute.study.calibrate import calibrate

        began = perf_counter()

        def tell(share: float, words: str, name: str = name) -> None:
            print(f"\r{name}: {words}   ", end="", flush=True)

        calibrate(STUDY, given.out, replicates, disturbance, noise, given.workers, progress=tell)
        STORED.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(given.out / f"{name}.json", STORED / f"{name}.json")
        write_page()
        print(f"\n{name}: {(perf_counter() - began) / 60.0:.1f} min")
    write_page()


if __name__ == "__main__":
    main()
