"""What a first run costs, counted on a program that compiles a known number of functions."""

from __future__ import annotations

import first_run
import pytest

RUN = """
import jax
import jax.numpy as jnp

def run_study(study, out, progress):
    progress("fit", 0.0, "begins")
    for power in range(2, 2 + int(study.read_text())):
        jax.jit(lambda x, power=power: jnp.linalg.matrix_power(x, power))(jnp.ones((2, 2))).block_until_ready()
    progress("report", 1.0, "done")
"""


def test_compiled_functions_and_stages_of_a_run_are_counted(tmp_path):
    package = tmp_path / "src" / "bayeschute" / "study" / "run"
    package.mkdir(parents=True)
    for folder in (package, package.parent, package.parents[1]):
        (folder / "__init__.py").touch()
    (package / "stages.py").write_text(RUN, encoding="utf-8")
    (package.parent / "load.py").write_text("load_study = lambda path: path\n", encoding="utf-8")
    made = []
    for count in (1, 3):
        study = tmp_path / "study.toml"
        study.write_text(str(count), encoding="utf-8")
        made.append(first_run.measured(tmp_path, study, tmp_path / "cache"))
    one, three = made
    assert three["compilations"] - one["compilations"] == 2 and three["programs"] == one["programs"] == 0
    assert set(one["stages"]) == {"fit", "report"} and 0.0 < one["compile_s"] < one["processor_s"]
    said = first_run._row("here", "empty", one)
    assert f"{one['compilations']} functions compiled by XLA" in said and "report" in said


def test_an_earlier_run_s_functions_are_told_as_kept():
    made = {
        "processor_s": 1.0,
        "wall_s": 1.0,
        "compilations": 22,
        "kept": 21,
        "compile_s": 0.1,
        "programs": 9,
        "stages": {},
    }
    assert "1 functions compiled by XLA" in first_run._row("here", "filled", made)
    assert first_run._ratio({"processor_s": 3.0}, {"processor_s": 2.0}) == 1.5


@pytest.mark.slow
def test_a_first_run_of_the_default_study_compiles_few_functions(tmp_path):
    """A tenth of a second each, again for every number of samples, parameters and columns: 290 before NumPy took most."""
    made = first_run.measured(first_run.ROOT, first_run.STUDY, tmp_path)
    assert 0 < made["compilations"] <= 80 and 0 < made["programs"] and set(made["stages"]) == set(first_run.STAGES)
