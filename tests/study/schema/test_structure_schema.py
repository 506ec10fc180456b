"""`[structure.polar]` and `[synthetic]` refuse what they can't use, and say where, what they got, what they wanted."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayeschute.study.load import check_study, load_study
from bayeschute.study.schema.structure_schema import CORE, PolarPoolTable

MODELS = Path(__file__).parents[3] / "models"


@pytest.fixture
def known(tmp_path: Path) -> Path:
    """The study of Table 7.3-1 with its vehicle in a folder of the test's own."""
    for place in ("studies/table-7-3-1.toml", "vehicles/cpas-two-mains.toml"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text((MODELS / place).read_text(encoding="utf-8"), encoding="utf-8")
    return tmp_path / "studies/table-7-3-1.toml"


def test_the_study_is_sound_and_says_what_it_does(known: Path):
    assert check_study(known) == []
    study = load_study(known)
    assert study.synthetic is not None and study.structure is not None
    assert study.synthetic.snr.by_name() == {"C_A": 51.0, "C_Y": 8.0, "C_N": 6.0}
    assert study.synthetic.replicates == 50 and study.synthetic.reading == "conventional"
    pools = study.structure.polar.pools()
    assert list(pools) == ["C_A", "C_Y", "C_N"] and len(pools["C_A"].candidates()) == 120
    assert study.structure.exchange and study.structure.noise == "colored" and study.structure.penalty_factor == 2.0


FAULTS = [
    (r'"speed", "alpha", "alpha_rate", "q", "distance", "closing",$', '"speed", "beta",', "[structure.polar.C_A] variables", "'beta' is no variable", "polar variables"),
    (r'"\(alpha-16deg\)_\+", "\(alpha-20deg\)', '"(alpha-0.3)_+", "(alpha-20deg)', "variables", "degrees", "polar variables"),
    (r'"overlap", "\(1.0', '"overlap", "(0.8-distance)_+", "(1.0', "[structure.polar.C_Y] variables", "more than once", "each only once"),
    (r'^first = \["1"\].*', 'first = ["alpha^3"]', "[structure.polar] C_A", "alpha^3", "are candidates"),
    (r'^first = \["1"\].*', 'extra = ["q*alpha"]', "[structure.polar] C_A", "q*alpha", "don't hold already"),
    (r'^first = \["1"\].*', "order = 6", "[structure.polar] C_A", "38,760 candidates", "at most 20,000"),
    (r'^first = \["1"\].*', "order = -1", "order", "-1", "from 0"),
    (r'^noise = "colored".*', 'noise = "pink"', "[structure] noise", "'pink'", "'smoothing'"),
    (r"^penalty_factor = 2.0.*", "penalty_factor = 0", "penalty_factor", "0", "> 0"),
    (r"^exchange = true.*", "sigma = { C_D = 0.1 }", "[structure.sigma] C_D", "unknown key", "C_A"),
    (r"^exchange = true.*", 'saturate = "auto"', "structure", 'with fit = "selected"', 'fit = "search"'),
    (r"^exchange = true.*", 'saturate = "sometimes"', "[structure] saturate", "sometimes", "'always'"),
    (r"^exchange = true.*", "exchnge = true", "[structure] exchnge", "unknown key", "exchange"),
    (r'^published = "table-7.3-1".*', 'published = "table-7.1-2"', "[synthetic] published", "planar", "polar coefficients"),
    (r'^published = "table-7.3-1".*', 'published = "table-9"', "[synthetic] published", "'table-9'", "'table-7.3-1'"),
    (r'^reading = "conventional".*', 'reading = "upside_down"', "[synthetic] reading", "upside_down", "as_printed"),
    (r"^canopy = 1", "canopy = 3", "[synthetic] canopy", "canopy 3", "1 to 2"),
    (r"^canopy = 1", 'canopy = 1\nflight = "tame"', "[synthetic] flight", "'tame'", "lively"),
    (r"^replicates = 50", "replicates = 1", "[synthetic] replicates", "1", "from 2"),
    (r'^time_constant = "0.5 s".*', 'time_constant = "-1 s"', "[synthetic] time_constant", "'-1 s'", ">= 0 s"),
    (r"^C_A = 51", "C_A = -3", "[synthetic.snr] C_A", "-3", "> 0"),
    (r'"azimuth_rate", "sin_proximity",', '"sin_proximity",', "[structure.polar.C_Y] variables", "azimuth_rate", "all terms of"),
]  # fmt: skip


@pytest.mark.parametrize(("pattern", "new", "where", "got", "wanted"), FAULTS)
def test_faults_are_named(known: Path, spoil, pattern: str, new: str, where: str, got: str, wanted: str):
    faults = check_study(spoil(known, pattern, new))
    told = str(faults[0])
    assert len(faults) == 1, "\n".join(map(str, faults))
    assert where in told.split(": got")[0]
    assert got in told
    assert wanted in told


def test_a_pool_that_is_missing_is_asked_for(known: Path):
    text = known.read_text(encoding="utf-8")
    start, end = text.index("[structure.polar.C_N]"), text.index("[synthetic]")
    known.write_text(text[:start] + text[end:], encoding="utf-8")
    (fault,) = check_study(known)
    assert "[structure.polar] C_N" in fault.where and "that [synthetic] searches" in fault.wanted


def test_an_empty_ratio_is_refused(known: Path, spoil):
    for name in ("C_A = 51", "C_Y = 8", "C_N = 6"):
        spoil(known, f"^{name}.*", "")
    (fault,) = check_study(known)
    assert "[synthetic] snr" in fault.where and "one at least of C_A" in fault.wanted


def test_a_single_canopy_has_no_proximity(known: Path, spoil):
    vehicle = known.parent.parent / "vehicles/cpas-two-mains.toml"
    spoil(vehicle, "^number = 2", "number = 1")
    faults = [str(fault) for fault in check_study(known)]
    assert any("'distance'" in fault and "single canopy" in fault for fault in faults)


def test_a_descent_has_no_use_for_synthetic_data(descent: Path):
    text = descent.read_text(encoding="utf-8")
    table = '[synthetic]\npublished = "table-7.3-1"\ntime_constant = "1 s"\n[synthetic.snr]\nC_A = 5\n'
    descent.write_text(f"{text}\n{table}", encoding="utf-8")
    (fault,) = check_study(descent)
    assert "[synthetic]" in fault.where and "no use for" in fault.got


def test_candidates_are_known_by_any_spelling():
    pool = PolarPoolTable(variables=("overlap", "sin_proximity"), order=2, first=("sin_proximity*(0.8-distance)_+",))
    assert len(pool.candidates()) == 6


def test_a_core_is_named_once_and_not_empty(cluster: Path, spoil):
    text = cluster.read_text(encoding="utf-8")
    for new, wanted in (("core = []", "one at least"), ('core = ["axial[1]", "axial[1]"]', "each only once")):
        (fault,) = check_study(spoil(cluster, r"^core = .*", new))
        assert "[structure] core" in fault.where and wanted in fault.wanted
        cluster.write_text(text, encoding="utf-8")
    assert set(CORE) <= set(load_study(cluster).structure.core)


def test_a_fit_of_another_kind_is_refused(cluster: Path, spoil):
    (fault,) = check_study(spoil(cluster, r"^fit = .*", 'fit = "all"'))
    assert "[structure] fit" in fault.where and "search" in fault.wanted
