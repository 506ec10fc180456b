"""Two made-up sondes whose drag is known, and a finished run on them, shared by the tests of the whole way."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayeschute.core.numerics import clear_compiled
from tests.fitting import (  # noqa: F401
    bent,
    dense,
    descent,
    each_number,
    fails_beyond,
    falling,
    felt_flight,
    flown,
    found,
    gusty,
    linear,
    quadrature,
    settled,
    short,
    straight,
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Notebooks run for a minute each: first, so that no worker waits for them at the end."""
    items.sort(key=lambda item: not item.path.name.startswith("test_notebook"))


TRUTH = {"low": 0.155, "high": 0.160}  # C_D S/m [m^2/kg]
STUDY = """
title = "Two made-up sondes"
model = "descent"
seed = 4
[columns]
time = { column = "time_s", unit = "s" }
altitude = { column = "altitude_m", unit = "m" }
[[flight]]
name = "low"
file = "low.csv"
roles = ["identify", "predict"]
rate = "1 Hz"
identify_until = "65 %"
[[flight]]
name = "high"
file = "high.csv"
roles = ["identify", "predict"]
rate = "1 Hz"
identify_until = "65 %"
[priors.given]
cds_over_mass = { median = "0.12 m^2/kg", log_sd = 0.5 }
[noise]
descent_rate = { white = "0.3 m/s", correlated = "0.3 m/s", time_constant = "3 s" }
[noise.wind]
vertical = "0.5 m/s"
time_constant = "30 s"
[sampler]
chains = 2
warmup = 50
draws = 100
[predict]
draws = 100
[[requirement]]
name = "speed at the end"
quantity = "descent_rate"
statistic = "final"
at_most = "14 m/s"
"""


@dataclass(frozen=True)
class Descents:
    """A folder with a study, the records it names, and the drag they were made with."""

    study: Path
    truth: dict[str, float]


def descent_altitude(cds_over_mass: float, start: float, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Altitude of a body at its terminal speed in a standard day's air that goes up and down (samples,) [m]."""
    from bayeschute.atmosphere.standard import standard_density

    altitude, gust = np.empty(samples), 0.0
    altitude[0] = start
    for i in range(1, samples):
        gust += -gust / 30.0 + 0.4 * np.sqrt(2.0 / 30.0) * rng.standard_normal()
        terminal = np.sqrt(2.0 * 9.80665 / (cds_over_mass * float(standard_density(altitude[i - 1]))))
        altitude[i] = altitude[i - 1] - terminal - gust
    return altitude + 0.3 * rng.standard_normal(samples)


@pytest.fixture(scope="session")
def descents(tmp_path_factory: pytest.TempPathFactory) -> Descents:
    folder, rng = tmp_path_factory.mktemp("descents"), np.random.default_rng(11)
    for name, drag in TRUTH.items():
        altitude = descent_altitude(drag, 3000.0, 80, rng)
        rows = "".join(f"{i},{h:.3f}\n" for i, h in enumerate(altitude))
        (folder / f"{name}.csv").write_text("time_s,altitude_m\n" + rows, encoding="utf-8")
    (folder / "sondes.toml").write_text(STUDY, encoding="utf-8")
    return Descents(folder / "sondes.toml", TRUTH)


@dataclass(frozen=True)
class Finished:
    """A run that was never stopped: its folder, what it returned and what it told."""

    folder: Path
    summary: dict[str, Any]
    told: list[tuple[str, float, str]]


@pytest.fixture(scope="session")
def finished(descents: Descents, tmp_path_factory: pytest.TempPathFactory) -> Finished:
    from bayeschute.study.run.stages import run_study

    folder = tmp_path_factory.mktemp("runs") / "whole"
    told: list[tuple[str, float, str]] = []
    summary = run_study(descents.study, folder, progress=lambda *said: told.append(said))
    return Finished(folder, summary, told)


_MOST_RESIDENT = 1.5 * 2**30  # of a worker, after a test file [byte]; none adds more than a third of it


@pytest.fixture(autouse=True, scope="module")
def _room_for_compiled_functions() -> Iterator[None]:
    """The suite in one process would need more memory maps than Linux allows; a run may keep more of them than a test.

    Nor does a worker need the functions of all test files before: they would take 3 GiB.
    """
    yield
    clear_compiled(0 if _resident() > _MOST_RESIDENT else 15_000)


def _resident() -> float:
    """Memory of this process [byte]; none where it can't be told (not Linux)."""
    told = Path("/proc/self/statm")
    return float(told.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if told.exists() else 0.0
