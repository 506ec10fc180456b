"""Shipped studies of measured descents: fitted, and the held-out rest of every record predicted and scored.

Each study of `STUDIES` fits the first part of its records and predicts the rest, which was flown. Scores are those of
``other_flights.py``; the band is that of the rate as it would be recorded, so that the instrument's noise counts on
both sides, and climatology is the constant band of the fitted part.

    python benchmarks/measured_flights.py --data ../shared/realdata [--studies dropsondes halcyon] [--workdir DIR]
        [--json] [--store DIR]

``--store`` keeps a file per study, from which ``evidence_page.py`` writes its page.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of
from other_flights import run, verdict
from other_scores import LEVELS, History, constant, score

import bayeschute as bc
from bayeschute.study.evidence.provenance import provenance

ROOT = Path(__file__).parents[1]
STUDIES = ("dropsondes", "halcyon")
QUANTITY = "descent_rate"


def scored(forecast: bc.Forecast) -> dict[str, Any]:
    """Scores of the held-out part of a record.

    Args:
        forecast: Of a flight that was fitted in part.
    """
    time, record, unseen = forecast.draws["time"].values, forecast.record[QUANTITY], forecast.held_out
    seen = forecast.as_recorded(QUANTITY).quantile(list(LEVELS), "draw").values
    truth = [History(time[unseen], record[unseen])]
    usual = constant(np.nanquantile(record[~unseen], LEVELS), time[unseen])
    ours, plain = score(time[unseen], seen[:, unseen], truth), score(time[unseen], usual, truth)
    return ours._asdict() | {"climatology": plain._asdict(), "wis_over_climatology": ours.wis / plain.wis}


def results(name: str, data: Path, place: Path) -> dict[str, Any]:
    """Run a study and score its predictions.

    Args:
        name: Of the study.
        data: Folder of the records.
        place: Working folder.
    """
    study, out = place / f"{name}.toml", place / name
    study.write_text((ROOT / "models/studies" / study.name).read_text(encoding="utf-8"), encoding="utf-8")
    told = provenance(f"benchmarks/measured_flights.py --data ../shared/realdata --studies {name}")
    ran = run(study, out, "--data", str(data))
    made = {"study": name, "processor_s": ran["processor_s"], **verdict(out, ran), "flights": {}, "provenance": told}
    if (out / "predictions.nc").is_file():
        forecasts = bc.Run(out, bc.Study.load(study, data)).forecasts
        made["flights"] = {name: scored(one) for name, one in forecasts.items() if one.held_out.any()}
    return made


def lines(made: dict[str, Any]) -> list[str]:
    """Results in words."""
    how = "converged" if made["converged"] else f"NOT CONVERGED, {made['reason']}"
    missed = ", ".join(made["failed"]) or "none"
    said = [f"{made['study']}  {how}; {made['processor_s']:.0f} s processor; checks missed: {missed}", made["label"]]
    said += [
        f"   {name:<18} held {100 * s['held']:3.0f} % of {s['samples']}, width {s['width']:.2f} m/s, "
        f"bias {s['bias']:+.2f}, WIS over climatology {s['wis_over_climatology']:.2f}"
        for name, s in made["flights"].items()
    ]
    return said


def main() -> None:
    """Run, print, store."""
    parser = parser_of(__doc__)
    parser.add_argument("--data", type=Path, default=ROOT / "../shared/realdata", help="folder of the records")
    parser.add_argument("--studies", nargs="+", choices=STUDIES, default=STUDIES)
    parser.add_argument("--workdir", type=Path, help="runs  [default: a temporary folder]")
    parser.add_argument("--store", type=Path, metavar="DIR", help="keep the results there, a file per study")
    given = parser.parse_args()
    if not given.data.is_dir():
        sys.exit(f"{given.data}: no such folder; --data says where the records are")
    with tempfile.TemporaryDirectory() as temporary:
        place, every = given.workdir or Path(temporary), {}
        place.mkdir(parents=True, exist_ok=True)
        for name in given.studies:
            every[name] = made = results(name, given.data.resolve(), place)
            print("\n".join(lines(made)), flush=True)
            if given.store:
                given.store.mkdir(parents=True, exist_ok=True)
                text = json.dumps(made, indent=1, ensure_ascii=False) + "\n"
                (given.store / f"{name}.json").write_text(text, encoding="utf-8")
    if given.json:
        print(json.dumps(every))


if __name__ == "__main__":
    main()
