"""Touchdown of flights of another program, foretold by landings from their identified flights.

For every set that has true histories: `Posterior.land` flies the predicted flight's vehicle through its estimated wind,
from the altitude and the swing at which its record begins, to the ground; its azimuth, rates and cone are drawn, as a
campaign does that knows no record. Histories end at the ground: their last sample is compared with the 90 % limits.

    python benchmarks/other_flights.py --data ../shared/otherflights --sets P S --workdir DIR
    python benchmarks/other_touchdown.py --data ../shared/otherflights --workdir DIR [--sets P S]
        [--landings 2048] [--json]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of
from other_records import flights_of, read_flight

QUANTITIES = {  # of a landing: name in a truth file, factor to its unit, that unit
    "vertical_speed": ("descent_rate_mps", 1.0, "m/s"),
    "sea_level_vertical_speed": ("sea_level_descent_rate_mps", 1.0, "m/s"),
    "swing_angle": ("swing_angle_deg", 180.0 / np.pi, "deg"),
}
SHARES = (0.05, 0.5, 0.95)
SWING_SD = 1.0  # of the swing that the record begins with [deg]


def foretold(data: Path, runs: Path, name: str, landings: int) -> dict[str, Any]:
    """Limits of a flight's touchdown and its true ones.

    Args:
        data: Folder of the sets.
        runs: What `other_flights.py` took for ``--workdir``.
        name: Of the flight, such as ``P_2``.
        landings: How many.

    Returns:
        By quantity ``limits`` (5, 50 and 95 %), ``truths`` and ``inside``, the share of these; ``failed`` landings.
    """
    import bayeschute as bc

    folder = runs / name[0] / "run"
    study = bc.Study.load(folder / "study.toml")
    record = read_flight(data, name)
    swing = float(record.quantities()["swing_angle"][np.isfinite(record.quantities()["swing_angle"])][0])
    begin = -float(record.position[np.isfinite(record.position[:, 2]), 2][0])
    ground = float(record.meta["ground_altitude_msl_m"])
    made = bc.Run(folder, study).posterior.land(
        study.flights[name],
        draws=landings,
        start={"altitude": f"{begin} m", "swing": {"mean": f"{swing} deg", "sd": f"{SWING_SD} deg"}},
        ground={"altitude": f"{ground} m"},
    )
    truths = [dict(np.load(path)) for path in sorted((data / "truth").glob(f"{name}_*.npz"))]
    told: dict[str, Any] = {"failed": made.failed, "landings": landings}
    for quantity, (theirs, factor, unit) in QUANTITIES.items():
        limits = factor * np.nanquantile(made.rows[quantity], SHARES)
        last = np.array([float(truth[theirs][-1]) for truth in truths])
        inside = float(np.mean((last >= limits[0]) & (last <= limits[2])))
        told[quantity] = {"unit": unit, "limits": limits.tolist(), "truths": last.tolist(), "inside": inside}
    return told


def main() -> None:
    """Fly, compare, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--workdir", type=Path, required=True)
    parser.add_argument("--sets", nargs="+", default=["P", "S"])
    parser.add_argument("--landings", type=int, default=2048)
    given = parser.parse_args()
    found: dict[str, Any] = {}
    for which in given.sets:
        if not (given.workdir / which / "run" / "posterior.nc").is_file():
            sys.exit(f"{given.workdir / which}: no posterior of set {which} is here: run other_flights.py first")
        for name in flights_of(given.data, which)[1:]:
            if not list((given.data / "truth").glob(f"{name}_*.npz")):
                continue
            found[name] = foretold(given.data, given.workdir, name, given.landings)
            print(f"{name}: {given.landings} landings, {found[name]['failed']} failed")
            for quantity in QUANTITIES:
                one = found[name][quantity]
                low, middle, high = one["limits"]
                seen = f"{min(one['truths']):.2f} to {max(one['truths']):.2f}"
                print(
                    f"   {quantity:25} 90 % limits {low:.2f} to {high:.2f}, median {middle:.2f} {one['unit']}; "
                    f"{len(one['truths'])} true touchdowns {seen}, {one['inside']:.0%} inside"
                )
    if given.json:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
