from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser

import pytest

from bayeschute.calibration.label import Level, Rung, claim
from bayeschute.core.errors import InputError
from bayeschute.report import page as html
from bayeschute.report.page import build_report
from bayeschute.report.run_results import read_results

SECTIONS = (
    "input", "structure", "posterior", "identifiability", "predictions", "checks", "risk", "notes", "provenance",
)  # fmt: skip
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Collects tags, addresses and unclosed elements."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.faults: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)


def visible(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<style>.*?</style>", "", text)))


@pytest.fixture(scope="module")
def text(run_dir):
    return (run_dir / "report.html").read_text(encoding="utf-8")


@pytest.fixture
def bare(tmp_path):
    (tmp_path / "summary.json").write_text("{}")
    return tmp_path


def test_the_page_is_well_formed_and_has_every_section(text):
    page = Page(text)
    assert not page.faults and not page.open
    ids = {attrs.get("id") for tag, attrs in page.tags if tag == "section"}
    assert set(SECTIONS) <= ids
    links = [attrs["href"] for tag, attrs in page.tags if tag == "a"]
    assert links == [f"#{name}" for name in SECTIONS]
    assert 'class="missing"' not in text


def test_the_page_needs_no_network(text):
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {"script", "link", "iframe", "object"}
    for _, attrs in page.tags:
        for key in ("src", "href"):
            assert (attrs.get(key) or "data:").startswith(("data:", "#"))
    assert not re.search(r"url\(|@import|https?://", re.sub(r"data:image/svg\+xml,[^\"]*", "", text))


def test_every_picture_is_inside_and_told_in_words(text, run_dir):
    images = [attrs for tag, attrs in Page(text).tags if tag == "img"]
    files = sorted((run_dir / "figures").iterdir())
    assert len(images) == len(files) / 2 == 12
    assert {path.suffix for path in files} == {".png", ".svg"}
    assert all(path.stat().st_size > 3000 for path in files)
    assert all(len(attrs["alt"] or "") > 30 for attrs in images)
    assert all((attrs["src"] or "").startswith("data:image/svg+xml,<?xml") for attrs in images)


def test_what_a_reader_must_see_is_there(text):
    words = visible(text)
    for phrase in (
        "Not for use",
        "not checked: no calibration run",
        "Not promised by any calibration: riser_length.",
        "innovations of capsule_velocity.north",
        "is met with probability 0.9",
        "which was not fitted",
        "8 of 9 parameters with a known true value",
        "3 simulations of the sampling failed",
        "-141 m in one sample",
        "sqrt(mse)",
        "2 terms selected out of 6 candidates",
        "Seed 1.",
        "6c59dd1147eb600d13096aa7d491496e",
        "restoring force beyond 35 deg",
    ):
        assert phrase in words, phrase


def test_no_number_of_the_program_leaks_through(text):
    words = visible(text)
    assert not re.search(r"\b(nan|None|inf|Undefined|True|False)\b", words)


def test_a_summary_alone_gives_a_report_that_says_what_is_missing(bare):
    words = visible(build_report(bare).read_text())
    assert "not checked: the summary contains no label" in words
    for name in ("structure.json", "posterior.nc", "predictions.nc", "flights/", "exceedance.csv"):
        assert name in words
    assert "Treat every interval as not checked" in words
    assert "Not for use" not in words
    assert not (bare / "figures").exists()


def test_a_command_in_the_label_is_shown_as_code(bare):
    (bare / "summary.json").write_text(
        json.dumps(
            {
                "label": "not checked (run `bayeschute calibrate <b>` <i>first</i>)",
                "claim": {"sentences": ["No level applies (run `bayeschute check`)."]},
            }
        )
    )
    text = build_report(bare).read_text(encoding="utf-8")
    assert text.count("(run <code>bayeschute calibrate &lt;b&gt;</code> &lt;i&gt;first&lt;/i&gt;)") == 2
    assert "No level applies (run <code>bayeschute check</code>)." in text


def test_damaged_files_are_named_and_do_not_break_it(bare):
    (bare / "structure.json").write_text("[1, 2")
    (bare / "posterior.nc").write_bytes(b"\x89HDF not really")
    (bare / "risk").mkdir()
    (bare / "risk" / "exceedance.csv").write_text("a,b\n1,2\n")
    (bare / "risk" / "tolerance.csv").touch()
    words = visible(build_report(bare).read_text())
    assert "structure.json could not be read" in words
    assert "posterior.nc could not be read" in words
    assert "tolerance.csv could not be read" in words


def test_values_of_the_wrong_kind_do_not_break_it(bare):
    odd = {
        "title": "<script>alert(1)</script>",
        "parameters": {
            "a[1]": {"mean": None, "sd": float("nan"), "truth": "?"},
            "b": 3,
            "cds_over_mass": {"mean": 0.16},
        },
        "coverage": {"x": None, "y": {"swing_angle": None, "descent_rate": {"truth": None, "record": 0.5}}},
        "checks": {"rhat": {"passed": False, "value": float("inf"), "bound": None}, "odd": "no"},
        "flights": {"x": {"repairs": "many", "roles": None}},
        "requirements": [{"name": "r"}, 3, {"name": "s", "at_least": 2.0, "unit": "m", "probability_met": 1.0}],
        "sampling": {"nuts": {"chains": 4}, "emcee": {"chains": 8}},
        "noise": {"c": None, "d": 3, "e": {"white": "loud", "frequency": None}},
        "notes": "none",
        "versions": None,
        "identifiability": {
            "x": 3,
            "y": {"parameters": {"a[1]": None, "b": {"noise_share": "much", "likelihood_interval": {"low": 1}}}},
            "z": {"parameters": 5, "directions": [{"weights": None}, 3, {"contraction": 7, "words": "b"}], "noise": []},
        },
    }
    (bare / "summary.json").write_text(json.dumps(odd))
    (bare / "structure.json").write_text(json.dumps({"coefficients": {"axial": {}, "odd": 3}}))
    text = build_report(bare).read_text()
    assert "<script>" not in text
    assert "1 of 1 check failed (rhat)" in visible(text)
    assert not Page(text).faults


def test_without_a_summary_there_is_a_plain_fault(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        build_report(tmp_path)
    (tmp_path / "log.txt").write_text("stopped in the fit")
    with pytest.raises(InputError, match="has not come to its end.*--resume"):
        build_report(tmp_path)
    (tmp_path / "summary.json").write_text("[]")
    with pytest.raises(InputError, match="JSON object"):
        build_report(tmp_path)


def test_a_failed_build_leaves_the_old_report(bare, monkeypatch):
    path = build_report(bare)
    old = path.read_text()

    def broken(results):
        raise RuntimeError("broken")

    monkeypatch.setattr(html, "_context", broken)
    with pytest.raises(RuntimeError):
        build_report(bare)
    assert path.read_text() == old


@pytest.mark.parametrize(("contradicted", "pill"), [([], "good"), (["bands contain 35 %"], "weak")])
@pytest.mark.usefixtures("no_pictures")
def test_the_first_screen_has_the_colour_and_the_words_of_the_label(make_run, tmp_path, contradicted, pill):
    made = claim([Rung(Level.SELF_CONSISTENT, (), "120 replicates")], contradicted)
    folder = make_run(tmp_path, label=made.label)
    text = build_report(folder).read_text()
    spans = [attrs["class"] for tag, attrs in Page(text).tags if tag == "span" and "pill" in (attrs.get("class") or "")]
    assert spans == [f"pill {pill}"] * 2
    assert visible(text[text.index("<header>") : text.index("</header>")]).count(made.label) == 1


def test_a_run_without_truth_or_structure(make_run, tmp_path, monkeypatch):
    folder = make_run(tmp_path, label="self-consistent: 120 replicates")
    for name in ("structure.json", "posterior.nc", "predictions.nc"):
        (folder / name).unlink()
    for name in ("risk", "flights"):
        shutil.rmtree(folder / name)
    words = visible(build_report(folder).read_text())
    assert "self-consistent: 120 replicates" in words
    assert "Not for use" not in words
    assert "Without posterior.nc" in words


def _requirements(folder, **changes):
    """The run's one requirement changed, and its results anew."""
    summary = json.loads((folder / "summary.json").read_text())
    summary["requirements"] = [summary["requirements"][0] | changes]
    (folder / "summary.json").write_text(json.dumps(summary))
    return read_results(folder)


def test_limits_are_drawn_upon_the_statistic_they_are_set_on(make_run, tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(
        html.record_figures, "exceedance_figure", lambda table, limits: drawn.update(table=table, limits=limits)
    )
    monkeypatch.setattr(html.record_figures, "band_figure", lambda bands, limits: drawn.update(bands=limits))
    monkeypatch.setattr(html, "_picture", lambda *_: None)
    folder = make_run(tmp_path)
    for statistic, at_every_time in (("mean", {}), ("final", {}), ("maximum", {"sea_level_descent_rate": 10.0584})):
        results = _requirements(folder, statistic=statistic)
        html._exceedance_picture(results, tmp_path)
        html._band_pictures(results, tmp_path)
        assert drawn["limits"] == {("sea_level_descent_rate", statistic): [10.0584]}
        assert drawn["bands"] == at_every_time
    first = drawn["table"].iloc[0]
    assert (first.quantity, first.statistic) == ("swing_angle", "maximum"), "no draws of the maximum: the usual ones"
    html._exceedance_picture(_requirements(folder, statistic="mean"), tmp_path)
    first = drawn["table"].iloc[0]
    assert (first.quantity, first.statistic) == ("sea_level_descent_rate", "mean")


def test_the_end_of_a_record_is_not_called_a_landing(text):
    words = visible(text)
    assert not re.search(r"touchdown|\bland(s|ed|ings)\b", words, re.IGNORECASE)
    assert "at the end of the record" in words and "is no landing" in words
