"""Do the 90 % intervals of a swing's frequency and damping ratio hold the truth nine times in ten?

Replicates of damped swings with known frequency and damping, made by kicks at random instants (not by the filter that
fits them), in noise that is an Ornstein-Uhlenbeck process plus white:

    gusty    15 cycles, damping ratio 0.02, gusts that drive the swing, two directions
    short    8 cycles, 0.01, strong gusts and noise, two directions (a rocket under twisted lines)
    single   20 cycles, 0.05, one direction
    free     15 cycles, 0.02, no gusts, and the fit knows that there are none
    free?    the same records, fitted as if there might be gusts
    as free  the gusty records, fitted as if free: what a damped sinusoid in colored noise promises

    python benchmarks/modal_coverage.py [--replicates 240] [--seed 11] [--json]
"""

from __future__ import annotations

import importlib.util
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
from command import parser_of, print_result

from bayeschute.swing.modal import fit_swing


def _twin() -> ModuleType:
    """The maker of swings, which the tests use, too."""
    path = Path(__file__).parents[1] / "tests" / "twins" / "damped_swing.py"
    spec = importlib.util.spec_from_file_location("damped_swing", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["damped_swing"] = module
    spec.loader.exec_module(module)
    return module


def main() -> None:
    """Count and print."""
    parser = parser_of(__doc__)
    parser.add_argument("--replicates", type=int, default=240)
    parser.add_argument("--seed", type=int, default=11)
    options = parser.parse_args()
    twin = _twin()
    gusty = twin.Swing(forcing=0.09, colored=0.1, tau=1.5, white=0.005)
    short = replace(
        gusty, frequency=0.97, damping_ratio=0.01, amplitude=(1.2, 0.5), forcing=0.25, colored=0.27, tau=0.8,
        white=0.01, samples=50,
    )  # fmt: skip
    single = replace(
        gusty, damping_ratio=0.05, amplitude=(1.0,), forcing=0.05, tau=0.3, white=0.01, samples=120
    )  # fmt: skip
    cases = {
        "gusty": (gusty, True),
        "short": (short, True),
        "single": (single, True),
        "free": (twin.Swing(), False),
        "free?": (twin.Swing(), True),
        "as free": (gusty, False),
    }
    ratios: dict[str, float] = {}
    start, widths = time.perf_counter(), {}
    print(f"{options.replicates} replicates; share of 90 % intervals that hold the truth, median half width")
    print(f"{'case':10} {'frequency':>10} {'width [Hz]':>11} {'damping':>9} {'width':>8} {'untrusted':>10}")
    for name, (swing, forcing) in cases.items():
        inside, width, untrusted = np.zeros(2), [], 0
        for replicate in range(options.replicates):
            data = twin.make(swing, np.random.default_rng([options.seed, replicate]))
            fit = fit_swing(data, swing.dt, band=(0.5, 1.6), forcing=forcing, settle=False)
            truth = (swing.damped_frequency, swing.damping_ratio)
            found = (fit.frequency, fit.damping_ratio)
            inside += [i.low <= v <= i.high for i, v in zip(found, truth, strict=True)]
            width.append([0.5 * (i.high - i.low) for i in found])
            untrusted += not fit.trusted
        share, half = inside / options.replicates, np.median(width, axis=0)
        widths[name] = half
        print(f"{name:10} {share[0]:10.3f} {half[0]:11.5f} {share[1]:9.3f} {half[1]:8.4f} {untrusted:10d}", flush=True)
        key = name.replace(" ", "_").replace("?", "_forced_fit")
        ratios |= {f"{key}_frequency_coverage": share[0], f"{key}_damping_coverage": share[1]}
    ratios["as_free_over_gusty_width"] = float(widths["as free"][0] / widths["gusty"][0])
    wall = time.perf_counter() - start
    context = {
        "replicates": options.replicates,
        "seed": options.seed,
        "wall_s": wall,
        "s_per_fit": wall / len(cases) / options.replicates,
    }
    print(f"{context['s_per_fit']:.2f} s per fit")
    print_result(options, {k: float(v) for k, v in ratios.items()}, context)


if __name__ == "__main__":
    main()
