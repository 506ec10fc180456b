"""The shipped calibration: campaigns and rank tests, stored under models/reference, and docs/calibration.md.

Every campaign is one call of ``bayeschute calibrate``, every rank test one of ``benchmarks/ranks.py``. Finished
replicates are kept, so the same command goes on where it was stopped; the time it took is the sum of its parts.
``--page`` writes the page again from what is stored, without flying anything.

Workers stay for all of them, and so does what they compiled. The longest campaign comes last.

    python benchmarks/calibration.py [--workers 2] [--only latent.none ranks.dumbbell] [--few 40] [--many 120] [--page]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from calibration_page import page

from bayeschute.calibration.workers import kept_open

sys.path.insert(0, str(Path(__file__).parent))
ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
STORED = ROOT / "models" / "reference" / "calibration"
PAGE = ROOT / "docs" / "calibration.md"
COMMAND = "python benchmarks/calibration.py"
FIRST_SEED = 40_000  # none of these flights was seen while the approximations of the inference were chosen
FEW = 40
MANY = 120
CAMPAIGNS = (  # noise model, disturbance, replicates
    ("latent", "none", MANY),
    ("ar1", "none", FEW),
    ("ar1+white", "none", FEW),
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
RANKS = {"dumbbell": 305, "cluster": 105}  # 300 and 100 are wanted, and a fit in a hundred may fail
Result = dict[str, Any]


def stored() -> tuple[list[Result], list[Result]]:
    """Results of campaigns, in the order of `CAMPAIGNS`, and of rank tests."""
    files = [STORED / f"{noise}.{disturbance}.json" for noise, disturbance, _ in CAMPAIGNS]
    made = [json.loads(f.read_text(encoding="utf-8")) for f in files if f.exists()]
    return made, [json.loads(f.read_text(encoding="utf-8")) for f in sorted(STORED.glob("ranks.*.json"))]


def write_page() -> None:
    """Write docs/calibration.md from what is stored."""
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(*stored(), COMMAND), encoding="utf-8")


def timed(name: str, out: Path, workers: int | None, fly: Callable[[], Result]) -> None:
    """Make a result, store it with the minutes that it took in all, stopped and begun again or not; write the page."""
    kept, began = out / f"{name}.minutes", perf_counter()
    before = float(kept.read_text(encoding="utf-8")) if kept.exists() else 0.0
    try:
        result = fly()
    finally:
        minutes = before + (perf_counter() - began) / 60.0
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(f"{minutes}\n", encoding="utf-8")
    STORED.mkdir(parents=True, exist_ok=True)
    whole = json.dumps({**result, "clock": {"minutes": minutes, "workers": workers}}, indent=1)
    (STORED / f"{name}.json").write_text(whole + "\n", encoding="utf-8")
    write_page()
    print(f"\n{name}: {minutes:.1f} min")


def campaign(noise: str, disturbance: str, replicates: int, out: Path, address: str | None) -> Result:
    """Replicates of the study."""
    from bayeschute.study.calibrate import calibrate

    def tell(share: float, words: str) -> None:
        print(f"\r{noise}.{disturbance}: {words}   ", end="", flush=True)

    return calibrate(STUDY, out, replicates, disturbance, noise, address=address, first_seed=FIRST_SEED, progress=tell)


def ranked(model: str, out: Path, address: str | None) -> Result:
    """Ranks of truths."""
    import ranks

    return ranks.test(model, RANKS[model], False, out, address=address)


def main() -> None:
    """Fly what is asked for, store it, and write the page after every part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [*(f"{noise}.{disturbance}" for noise, disturbance, _ in CAMPAIGNS), *(f"ranks.{m}" for m in RANKS)]
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--dask", metavar="ADDRESS", help="Dask scheduler, in place of --workers")
    parser.add_argument("--few", type=int, default=FEW, metavar="N", help=f"replicates of all but the first ({FEW})")
    parser.add_argument("--many", type=int, default=MANY, metavar="N", help=f"replicates of the first ({MANY})")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "calibration" / "cdt-3-11", help="for rows")
    parser.add_argument("--page", action="store_true", help="only write the page")
    given = parser.parse_args()
    if not given.page:
        with kept_open(given.workers, given.dask) as address:
            parts: dict[str, Callable[[], Result]] = {
                f"{noise}.{disturbance}": partial(
                    campaign, noise, disturbance, given.few if count == FEW else given.many, given.out, address
                )
                for noise, disturbance, count in sorted(CAMPAIGNS, key=lambda of: of[-1])
            }
            parts = {f"ranks.{model}": partial(ranked, model, given.out, address) for model in RANKS} | parts
            for name, fly in parts.items():
                if name in given.only:
                    timed(name, given.out, None if given.dask else given.workers, fly)
    write_page()


if __name__ == "__main__":
    main()
