"""By which power of the size costs grow, the page, and a small fit."""

from __future__ import annotations

import growth
import pytest

FOUND = {
    "flights": {1.0: {"parameters": 9, "processor_s": 12.0, "compiling_s": 2.0, "bytes": 2**30, "commit": "abcdef012"},
                4.0: {"parameters": 9, "processor_s": 43.0, "compiling_s": 3.0, "bytes": 2**31, "commit": "abcdef012+"}},
    "own": {1.0: {"parameters": 17, "processor_s": 20.0, "compiling_s": 2.0, "bytes": 2**30, "commit": "abcdef012"}},
}  # fmt: skip


@pytest.mark.parametrize("power", [0.0, 1.0, 2.5])
def test_the_exponent_is_that_of_a_power(power):
    assert growth.exponent({size: 3.0 * size**power for size in (1.0, 4.0, 20.0)}) == pytest.approx(power, abs=1e-12)


def test_compiling_is_not_counted_and_one_size_has_no_exponent():
    assert growth.exponents(FOUND) == pytest.approx({"time.flights": 1.0, "memory.flights": 0.5})


def test_the_page_tells_every_fit_and_its_command():
    here = {"date": "2026-01-02", "python": "3.11", "cpu": "a processor", "cores": 2, "load_average": 0.1}
    made = growth.page(FOUND, here, "python benchmarks/growth.py --flights 1 4")
    assert "| 4 flights | 9 | 40 s | 3 s | 2.00 GiB | `abcdef0` |" in made and "| flights | 1.00 | 0.50 |" in made
    assert "| 1 flight with errors of their own | 17 | 18 s | 2 s | 1.00 GiB | `abcdef0` |" in made
    assert made.startswith("<!-- Written by `python benchmarks/growth.py --flights 1 4`")
    assert "| flights with errors of their own | 1" not in made.split("powers")[1]


def test_fits_that_are_kept_are_not_made_again(tmp_path, monkeypatch, capsys):
    made = []

    def fitted(what, size, quick, cache):
        made.append((what, size))
        return FOUND["own"][1.0] | {"processor_s": 2.0 + size, "bytes": 2**30 * size**2}

    monkeypatch.setattr(growth, "fitted", fitted)
    for sizes in (["1"], ["1", "4"]):
        words = ["--flights", *sizes, "--own", "2", "--minutes", "--kept", str(tmp_path / "kept.jsonl")]
        monkeypatch.setattr("sys.argv", ["growth.py", *words, "--quick", "--out", str(tmp_path / "page.md")])
        growth.main()
    assert made == [("flights", 1.0), ("own", 2.0), ("flights", 4.0)]
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "| flights | 1.00 | 2.00 |" in page and "--flights 1 4 --own 2 --minutes --quick" in page
    assert "memory.flights    2.00" in capsys.readouterr().out


@pytest.mark.slow
def test_two_flights_with_errors_of_their_own_are_fitted(tmp_path):
    made = growth.fitted("own", 2, True, tmp_path)
    assert made["parameters"] >= 2 * 8 + 5 and 0.0 < growth.seconds(made) < made["processor_s"] and made["bytes"] > 0


def test_a_fit_that_fails_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(growth, "STUDY", tmp_path / "missing.toml")
    with pytest.raises(SystemExit, match="1 flights: the fit failed"):
        growth.fitted("flights", 1, True, tmp_path)
