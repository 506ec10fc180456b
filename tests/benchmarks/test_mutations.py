"""Random changes in the code: what is changed and what is left alone, and a tiny package whose tests are tried by them."""

from __future__ import annotations

import json
from pathlib import Path

import mutation_trials
import mutations
import pytest
from mutation_changes import applied, changes, shown, sound
from mutation_tests import Imports

MADE = [
    ("x = a + b", {"a - b"}),
    ("x = (a) * (\n    b  # not a / b\n)", {"(a) / (\n    b  # not a / b\n)"}),
    ("x += a", {"x -= a"}),
    ("x = a < b", {"a <= b", "a >= b"}),
    ("x = a is not b", {"a is b"}),
    ("x = a in b", {"a not in b"}),
    ("x = a and b", {"a or b"}),
    ("x = not a", {"x = a"}),
    ("if a: pass", {"if not a"}),
    ("x = 3", {"4", "2"}),
    ("x = 0.5", {"1.0", "0.25"}),
    ("x = True", {"False"}),
    ("x = min(a, b)", {"max(a, b)"}),
    ("x = np.argmax(a)", {"np.argmin(a)", "np.argmax(-a)"}),
    ("x = -a", {"x = a"}),
    ("x = a[-1]", {"a[-2]"}),
    ("x = a[:n]", {"a[:n + 1]", "a[:n - 1]"}),
    ("x = range(n)", {"range(n + 1)", "range(n - 1)"}),
    ('x = "größe" if a < b else c', {"a <= b", "a >= b"}),
]
LEFT_ALONE = [
    '"""1 + 1 < 3."""',
    "def f(x: Literal[1, 2] = None) -> tuple[3, 4]: pass",
    "x: Annotated[float, 1 + 1]",
    '__all__ = ["a"] + ["b"]',
    "x = 'a' + b",
    "x = f'{a + 1:.3f}'",
    "x = [a] + b",
    "x = folder / name",
    "x = Array | None",
    "raise ValueError(a + 1)",
    "assert a < 1",
    "faults.append(Fault(a, 1 + 1))",
    "@cache(1)\ndef f(): pass",
    "if TYPE_CHECKING:\n    x = 1",
    "x = zip(a, b, strict=True)",
]


def _each(text: str) -> list[str]:
    return [applied(text, change, choice) for change in changes(text) for choice in change.choices]


@pytest.mark.parametrize(("text", "wanted"), MADE)
def test_a_change_gives_another_program_that_compiles(text, wanted):
    made = _each(text)
    assert len(made) == len(wanted) and all(sound(text, one) for one in made)
    assert all(any(piece in one for one in made) for piece in wanted)


@pytest.mark.parametrize("text", LEFT_ALONE)
def test_texts_annotations_and_what_can_only_fail_are_left_alone(text):
    assert _each(text) == []


def test_a_change_is_shown_as_the_line_that_it_changes():
    text = "x = 1\n\nif (\n    a\n    and b\n):\n    y = 'ß' * 0 + b - c\n"
    told = {(one.line, *shown(text, one, one.choices[0])) for one in changes(text)}
    assert (5, "and b", "or b") in told and (7, "y = 'ß' * 0 + b - c", "y = 'ß' * 1 + b - c") in told


SOURCE = '''"""A tiny package: 1 + 1."""

FACTOR = 2.0


def twice(x: float) -> float:
    """Twice 1 + 1."""
    return FACTOR * x


def spin(n: int) -> int:
    """Down to 0."""
    while n > 0:
        n -= 1
    return n


def unseen(x: float) -> float:
    """Nobody asks."""
    return x - 1.0
'''
TESTS = """from tiny.numbers import spin, twice


def test_twice():
    assert twice(3.0) == 6.0


def test_spin():
    assert spin(2) == 0
"""
TOO_STRICT = """from pathlib import Path

import tiny.numbers


def test_the_text_is_as_it_was():
    assert hash(Path(tiny.numbers.__file__).read_text()) == hash({text!r})
"""


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A package with a mirrored test file and one that fails by whatever is written into the module."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # none is needed, and they take seconds
    monkeypatch.setattr(mutation_trials, "OPTIONS", ["-x", "-q", "-p", "no:cacheprovider"])
    root = tmp_path / "tree"
    package, tests = root / "src" / "tiny" / "room", root / "tests" / "room"
    package.mkdir(parents=True)
    tests.mkdir(parents=True)
    for place in (package.parent, package):
        (place / "__init__.py").write_text("", encoding="utf-8")
    (package / "numbers.py").write_text(SOURCE, encoding="utf-8")
    (tests / "test_numbers.py").write_text(TESTS.replace("tiny.", "tiny.room."), encoding="utf-8")
    strict = TOO_STRICT.replace("tiny.", "tiny.room.").replace("{text!r}", repr(SOURCE))
    (tests / "test_text.py").write_text(strict, encoding="utf-8")
    (root / "pyproject.toml").write_text('[tool.pytest.ini_options]\naddopts = "-ra"\n', encoding="utf-8")
    return root


def _one(root, line, piece):
    """The change of a line that gives a piece of text."""
    path = root / "src" / "tiny" / "room" / "numbers.py"
    text = path.read_text(encoding="utf-8")
    for change in changes(text):
        for choice in change.choices:
            before, after = shown(text, change, choice)
            if change.line == line and piece in after:
                file = path.relative_to(root).as_posix()
                return mutations.Mutant(
                    line, "room", file, line, change.kind, before, after, applied(text, change, choice)
                )
    raise LookupError(piece)


def test_a_seed_has_one_sample_that_longer_ones_begin_with(tree):
    all_of_it = mutations.sample(tree, ["room"], 100, 1)
    assert all_of_it == mutations.sample(tree, ["room"], 100, 1)
    assert mutations.sample(tree, ["room"], 3, 1) == all_of_it[:3] != mutations.sample(tree, ["room"], 3, 2)
    assert sorted(one.line for one in all_of_it) == [3, 8, 13, 14, 20]
    assert [one.number for one in all_of_it] == [1, 2, 3, 4, 5]
    with pytest.raises(SystemExit, match="cellar"):
        mutations.sample(tree, ["cellar"], 1, 1)


def test_the_mirror_comes_first_then_importers_by_distance(tree):
    (tree / "tests" / "test_far.py").write_text("import tiny.other", encoding="utf-8")
    (tree / "tests" / "test_none.py").write_text("import json", encoding="utf-8")
    (tree / "src" / "tiny" / "other.py").write_text("from tiny.room import numbers", encoding="utf-8")
    found = Imports.read(tree).nearest(tree / "src" / "tiny" / "room" / "numbers.py")
    wanted = [("tests/room/test_numbers.py", True), ("tests/room/test_text.py", False), ("tests/test_far.py", False)]
    assert found == wanted


def test_a_planted_change_is_caught_and_one_that_no_sound_test_sees_survives(tree, tmp_path):
    kept: list[dict] = []
    trials = mutation_trials.Trials(tree, tmp_path / "copies", 1, 20.0, kept.append)
    tests = Imports.read(tree).nearest(tree / "src" / "tiny" / "room" / "numbers.py")
    planted = trials.judge(_one(tree, 8, "FACTOR / x"), tests, 4)
    assert planted["result"] == "caught" and planted["by"] == "tests/room/test_numbers.py"
    assert "test_twice" in planted["said"] and planted["after"] == "return FACTOR / x"
    unseen = trials.judge(_one(tree, 20, "x + 1.0"), tests, 4)
    assert unseen["result"] == "survived" and unseen["passed"] == ["tests/room/test_numbers.py"]
    assert [(row["baseline"], row["sound"]) for row in kept] == [(tests[0][0], True), (tests[1][0], False)]
    assert (tree / "src" / "tiny" / "room" / "numbers.py").read_text(encoding="utf-8") == SOURCE
    trials.limit = 2.0
    assert trials.judge(_one(tree, 14, "n += 1"), tests, 4)["result"] == "timeout"
    trials.end()
    with pytest.raises(InterruptedError):
        trials.run(Path(), tests[0][0])


def test_a_run_that_was_ended_goes_on_and_other_samples_are_refused(tree, tmp_path, capsys):
    what, out = {"seed": 1}, tmp_path / "rows" / "of.jsonl"
    sampled = [_one(tree, 3, "4.0"), _one(tree, 8, "FACTOR / x")]
    done = sampled[0].told() | {"result": "survived", "by": None, "passed": [], "seconds": 1.0}
    mutations.Rows(out, what).keep(done)
    with out.open("a", encoding="utf-8") as file:
        file.write('{"number": 8, "resu')
    mutations.run(tree, sampled, mutations.Rows(out, what), 2, 4, 20.0, "abc")
    rows = mutations.Rows(out, what)
    assert rows.done[3] == done and rows.done[8]["result"] == "caught" and rows.done[8]["commit"] == "abc"
    mutations.run(tree, sampled, rows, 1, 4, 20.0, "abc")
    assert capsys.readouterr().out.count("FACTOR / x") == 1
    assert all(json.loads(line) for line in out.read_text().splitlines() if not line.endswith('"resu'))
    with pytest.raises(SystemExit, match="--out"):
        mutations.Rows(out, {"seed": 2})


def test_a_sample_joins_those_that_are_stored_and_replaces_an_earlier_part_of_itself(tmp_path):
    path, rows = tmp_path / "changes.json", [{"number": 1}, {"number": 2}]
    first, part = {"sample": {"seed": 1}, "rows": rows[:1]}, {"sample": {"seed": 2}, "rows": rows[:1]}
    whole = {"sample": {"seed": 2}, "rows": rows}
    for made in (first, part, whole):
        mutations.store(path, mutations.with_sample(mutations.stored(path), made))
    assert mutations.stored(path) == [first, whole] and mutations.stored(tmp_path / "none.json") == []


def test_survivors_are_tried_again_where_their_lines_are_still_there(tree, monkeypatch, capsys):
    def row(line, piece, **more):
        return _one(tree, line, piece).told() | {"result": "survived", "by": None, "passed": [], "seconds": 1.0} | more

    caught, unseen = row(8, "FACTOR / x"), row(20, "x + 1.0")
    gone, harmless = row(3, "4.0", before="FACTOR = 7.0"), row(14, "n += 1")
    samples = [{"harmless": [14], "rows": [caught, unseen, gone, harmless]}]
    before = [dict(gone), dict(harmless)]
    module = tree / "src" / "tiny" / "room" / "numbers.py"
    module.write_text("# A line more.\n" + SOURCE, encoding="utf-8")
    mutations.try_survivors(tree, samples, 4, 20.0, "abc")
    assert (caught["result"], caught["at_first"], caught["line"], caught["commit"]) == ("caught", "survived", 9, "abc")
    assert (unseen["result"], unseen["at_first"], unseen["commit"]) == ("survived", "survived", "abc")
    assert [gone, harmless] == before and capsys.readouterr().out.count("numbers.py:") == 2


def test_shares_leave_out_what_is_judged_to_be_harmless():
    rows = [
        {"number": n, "room": "a" if n < 3 else "b", "kind": "sign", "result": result}
        for n, result in enumerate(["caught", "timeout", "survived", "survived"], 1)
    ]
    made = mutations.shares(rows, harmless=[1, 3])
    assert made["all"]["all"]["changes"] == 3 and made["all"]["all"]["caught"] == 2
    assert made["room"]["a"] == {"changes": 2, "caught": 2, "timeouts": 1, "low": 0.224, "high": 1.0}
    assert made["room"]["b"]["caught"] == 0 and made["kind"]["sign"]["changes"] == 3
