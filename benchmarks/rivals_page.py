"""What users would pick instead, as one page of Markdown, from what ``rivals.py --store`` has kept.

python benchmarks/rivals_page.py
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from calibration_page import _table as table
from other_stored import ROOT, present

Result = dict[str, Any]
STORED = ROOT / "models/reference/rivals"
PAGE = ROOT / "docs/rivals.md"
NOTHING = "–"
OURS = "bayeschute"
CONVERGED = 1.1  # R-hat of draws that count
CASES = {
    "descent-gusts": "Descent in gusts",
    "descent-calm": "Descent in still air",
    "swing-gusts": "Swing in gusts",
    "swing-calm": "Swing in still air",
    "swing-wide": "Swing in gusts, wide priors",
    "cluster": "A record of the default study",
}
WORDS = {
    "descent-gusts": "A point mass, C_D S/m sought. Vertical air, fast and slow, that nobody recorded, and a sensor "
    "whose noise remembers. The last third of the record is predicted.",
    "descent-calm": "The same in still air, with white noise: the model that the others' likelihood assumes is true.",
    "swing-gusts": "The planar dumbbell, five coefficients sought. Gusts and an error of the recorded wind that nobody "
    "knows of, and sensors whose noise remembers. Another capsule in another wind is predicted from its true start.",
    "swing-calm": "The same in still air, with white noise. The posterior of so quiet a record is a curved valley: "
    "bayeschute answers under stronger noise than the record shows; its intervals and bands are wider than need be.",
    "swing-wide": "As in gusts, but priors several times as wide, centred 10 to 50 % off.",
    "cluster": "The drop of the default study, two canopies in three dimensions. The others see it as a planar "
    "dumbbell in the plane of its first swing, the most that a user would write; bayeschute runs its study. The "
    "look-alike is predicted: its swing angle to any side, and its descent rate. There are no true coefficients "
    "of a dumbbell.",
}
_HEAD = """\
# What a user would pick instead

Written by `python benchmarks/rivals_page.py`; do not edit. Numbers behind it, with command, commit, machine and
versions: `models/reference/rivals/*.json`. One command makes an environment with the others, makes the
records, runs all and scores them:

```sh
python benchmarks/rivals.py --seeds 1 2 3 --store models/reference/rivals
python benchmarks/rivals_page.py
```

One to three records a case show which way it goes; they measure no coverage. `--seeds` and `--limit` give more of both.

The limit of processor time is short, and most rivals' draws of the swing ran out of it; hours would serve them better.

Records are virtual flights by this program's simulator, which helps no one with the model, as all have the true one
(but for the last case), and helps bayeschute with the noise: its disturbances are of the kind that was flown. Every
program has a script of its own in `benchmarks/rivals/`, with the same priors and data, white residuals as these
tools offer them, and where the name says so an AR(1) likelihood. bayeschute's descent and cluster use its public door;
its dumbbell has none, and its script imports inner modules.

- *lines*: of the script, without blanks, comments and docstrings; model and prediction are included, reading and
  writing of the files is not.
- *failed*: records without a result. All other columns are means over the rest, so a program that fails on hard records
  looks better than it is.
- *processor*: seconds of the script's process, imports and compilation included. A script that ran out of its limit has
  an *R-hat* (the worst, over chains or walkers) above 1.05, and its other numbers are of draws that have not converged.
- *error*: root mean square of posterior mean less truth over truth (of a logarithm, the difference); *sd*: that of
  the posterior's standard deviations.
- *held*: true values in the nominal 90 % intervals, of all. Few records: a count, no measured coverage.
- *swing*, *descent*: percent of the true samples of the predicted motion inside the nominal 90 % band, the band's mean
  width, and the weighted interval score (lower is better). *with noise*: the same of the band to which the fit's
  residual noise is added, as users of white residuals would draw it; bayeschute's band has no measuring noise. Of both
  bands the better one counts below.
"""
_QUANTITIES = (("swing_angle", "swing", 57.29577951308232, "deg"), ("descent_rate", "descent", 1.0, "m/s"))


def stored(place: Path = STORED) -> list[Result]:
    """Stored cases, in the order of the page.

    Args:
        place: Folder of the stored files.
    """
    paths = [place / f"{case}.json" for case in CASES]
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.is_file()]


def _number(value: float | None, form: str, factor: float = 1.0) -> str:
    return NOTHING if value is None else format(factor * value, form)


def _spread(program: Result) -> float | None:
    """Root mean square of the posterior's standard deviations over the true values, of a logarithm as they are."""
    rows = [(n, p) for a in program["seeds"].values() for n, p in a.get("parameters", {}).items()]
    squares = [(p["sd"] / (1.0 if n.startswith("log_") else abs(p["truth"]))) ** 2 for n, p in rows]
    return (sum(squares) / len(squares)) ** 0.5 if squares else None


def case_table(one: Result) -> list[str]:
    """Table of a case.

    Args:
        one: As stored.
    """
    shown = [q for q in _QUANTITIES if any(q[0] in p["summary"] for p in one["programs"].values())]
    head = ["program", "lines", "records", "failed", "processor, s", "R-hat", "error, %", "sd, %", "held"]
    for _, words, _, unit in shown:
        head += [f"{words}: inside, %", f"width, {unit}", "score", "with noise, %", "score"]
    rows = []
    for name, program in one["programs"].items():
        s = program["summary"]
        held = f"{s['intervals_held']} of {s['intervals']}" if s["intervals"] else NOTHING
        row = [name, str(program["lines"]), str(s["records"]), str(s["failed"])]
        row += [_number(s["processor_s"], ".0f"), _number(s["worst_rhat"], ".2f"), _number(s["error"], ".1f", 100.0)]
        row += [_number(_spread(program), ".1f", 100.0), held]
        for key, _, factor, _ in shown:
            band, noisy = s.get(key), s.get(f"{key}.with_noise")
            row += [_number(band and band["held"], ".0f", 100.0), _number(band and band["width"], ".2f", factor)]
            row += [_number(band and band["wis"], ".3f", factor), _number(noisy and noisy["held"], ".0f", 100.0)]
            row.append(_number(noisy and noisy["wis"], ".3f", factor))
        rows.append(row)
    return table(head, rows)


def _score(key: str) -> Callable[[Result], float | None]:
    """Of the band of the motion, or of that with noise where it is better."""
    return lambda s: min((s[k]["wis"] for k in (key, f"{key}.with_noise") if k in s), default=None)


def _share(s: Result) -> float | None:
    return abs(s["intervals_held"] / s["intervals"] - 0.9) if s["intervals"] else None


MEASURES: tuple[tuple[str, Callable[[Result], float | None]], ...] = (
    ("processor time", lambda s: s["processor_s"]),
    ("error of the parameters", lambda s: s["error"]),
    ("intervals that hold the truth, by distance from 90 %", _share),
    ("score of the predicted swing", _score("swing_angle")),
    ("score of the predicted descent rate", _score("descent_rate")),
)


def winners(one: Result) -> Iterator[tuple[str, str, bool]]:
    """Measure, who is best in it, and whether that is another than bayeschute or beside it.

    A program counts where it has as many results as any, and its draws converged; bayeschute by the same rule.
    RocketPy, which identifies nothing, does not.

    Args:
        one: A case as stored.
    """
    programs = {name: p["summary"] for name, p in one["programs"].items()}
    most = max(s["records"] - s["failed"] for s in programs.values())
    counted = {
        name: s
        for name, s in programs.items()
        if s["records"] - s["failed"] == most
        and (s["worst_rhat"] or 1.0) < CONVERGED
        and not name.startswith("RocketPy")
    }
    for words, measure in MEASURES:
        values = {name: v for name, s in counted.items() if (v := measure(s)) is not None}
        if values:
            least = min(values.values())
            best = [name for name, v in values.items() if v <= 1.02 * least + 1e-9]
            yield words, ", ".join(best), OURS not in best
    lines = {name: one["programs"][name]["lines"] for name in counted}
    if lines:
        best = min(lines, key=lambda name: lines[name])
        yield "lines to write", best, best != OURS


def ahead(one: Result) -> Iterator[tuple[str, str]]:
    """Measure and programs that are ahead of bayeschute with draws that have not converged, or that answer at all.

    Args:
        one: A case as stored.
    """
    programs = {name: p["summary"] for name, p in one["programs"].items()}
    lost = programs[OURS]["failed"]
    fewer = [name for name, s in programs.items() if s["failed"] < lost and not name.startswith("RocketPy")]
    if fewer:
        yield f"an answer at all, where bayeschute failed on {lost} of {programs[OURS]['records']}", ", ".join(fewer)
    for words, measure in MEASURES[1:]:
        ours = measure(programs[OURS])
        found = {name: measure(s) for name, s in programs.items() if (s["worst_rhat"] or 1.0) >= CONVERGED}
        best = [name for name, v in found.items() if v is not None and ours is not None and v < 0.98 * ours]
        if best:
            yield words, ", ".join(best)


def failures(one: Result) -> Iterator[str]:
    """In words, a line each.

    Args:
        one: A case as stored.
    """
    for name, program in one["programs"].items():
        for seed, answer in program["seeds"].items():
            if "failed" in answer:
                yield f"- {name}, record {seed}: {answer['failed']}"
            elif answer["rhat"] is not None and answer["rhat"] >= 1.05:
                yield (
                    f"- {name}, record {seed}: ran out of its {one['limit_s']:.0f} s with R-hat {answer['rhat']:.2f}"
                    f" ({answer['note']})"
                )
    for name, why in one["unable"].items():
        yield f"- {name}: {why}"


def page(cases: Sequence[Result]) -> str:
    """The page.

    Args:
        cases: As stored.
    """
    text = [_HEAD, "## Where a rival wins", ""]
    rows = [[CASES[one["case"]], w, who] for one in cases for w, who, other in winners(one) if other]
    text += [
        "Of programs whose draws converged (R-hat below 1.1) and that answered for most records, best by another:",
        "",
    ]
    text += table(["case", "in", "best"], rows)
    rows = [[CASES[one["case"]], w, who] for one in cases for w, who in ahead(one)]
    if rows:
        text += [
            "Ahead of bayeschute by an answer alone, or with draws that have not converged:",
            "",
            *table(["case", "in", "ahead"], rows),
        ]
    rows = [[CASES[one["case"]], w, who] for one in cases for w, who, other in winners(one) if not other]
    text += ["## Where bayeschute is best, or as good", "", *table(["case", "in", "best"], rows)]
    for one in cases:
        made = one["provenance"]
        text += [f"## {CASES[one['case']]}", "", WORDS[one["case"]], ""]
        text += [*case_table(one), *failures(one), ""]
        commit = (made["commit"] or "no checkout")[:7] + "+" * str(made["commit"]).endswith("+")
        state = "present" if present(made) else "older"
        text += [
            f"Made by `{commit}` on {made['date']}, {state} numerics, {made['machine']}; limit {one['limit_s']:.0f} s.",
            "",
        ]
    return "\n".join(text).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(stored()), encoding="utf-8")
