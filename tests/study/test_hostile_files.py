"""Studies, vehicles and records damaged at random: clear faults or a clean check, never a traceback and never a hang."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from functools import partial
from pathlib import Path

import pytest
from tests.damages import outcomes

from bayeschute.study.load import check_study

MODELS = Path(__file__).parents[2] / "models"


@pytest.fixture
def targets(descents, tmp_path) -> list[tuple[Path, Path]]:
    """Files to be damaged, each with the study that is checked: a study, a record, a study of a cluster, a vehicle."""
    sondes, models = tmp_path / "sondes", tmp_path / "models"
    shutil.copytree(descents.study.parent, sondes)
    for folder in ("studies", "vehicles"):
        shutil.copytree(MODELS / folder, models / folder)
    study, cluster = sondes / descents.study.name, models / "studies" / "cdt-3-11.toml"
    assert check_study(study) == check_study(cluster) == []
    record = sondes / "low.csv"
    return [(study, study), (record, study), (cluster, cluster), (models / "vehicles/cpas-two-mains.toml", cluster)]


def _checked(targets: list[tuple[Path, Path]], number: int, seed: int) -> Counter[tuple[str, str]]:
    """How many files of each damage were told of, or were clean."""

    def read(study: Path) -> bool:
        faults = check_study(study)
        assert all(str(fault).strip() for fault in faults)
        return bool(faults)

    return outcomes([(path, partial(read, study)) for path, study in targets], number, seed)


def test_damaged_text_is_told_or_harmless(targets):
    count = _checked(targets, 320, seed=1)
    for kind in ("cut", "NUL", "depth"):  # those that leave no study, no vehicle and no record
        assert count[kind, "told"] > 0
    assert not count["depth", "clean"] and not count["NUL", "clean"]
    assert count["byte order mark", "told"] == 0 and count["byte order mark", "clean"] > 0


@pytest.mark.slow
def test_ten_thousand_damaged_texts_are_told_or_harmless(targets, capsys):
    count = _checked(targets, 10_000, seed=2)
    with capsys.disabled():
        sys.stdout.write("".join(f"\n{kind:>16} {told:<5} {many:>5}" for (kind, told), many in sorted(count.items())))
    assert sum(count.values()) == 10_000
