"""The pages' tables are small, say what their raw tables say, and their bold entries are the best ones."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("reader_tables", ROOT / "docs" / "reader_tables.py")
tables = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tables)
DECLARED = tables.declarations()
NUMBER = re.compile(r"(?<![\w.])\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")


def value(text):
    return float(text.replace(",", ""))


def made(name):
    """Return the heads of a table as it is written, and its rows of cells."""
    lines = [line for line in tables.markdown(name, DECLARED[name]).splitlines() if line.startswith("|")]
    heads, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return heads, rows


def test_pages_include_what_is_declared_and_all_of_it():
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*/*.md")]
    included = {name for page in pages for name in re.findall(r"\{include\} \.\./generated/tables/(.+)\.md", page)}
    assert included == set(DECLARED)


@pytest.mark.parametrize("name", DECLARED)
def test_a_table_is_small(name):
    heads, rows = made(name)
    assert 2 <= len(heads) <= 7
    assert 1 <= len(rows) <= 30
    assert all(len(row) == len(heads) for row in rows)


@pytest.mark.parametrize("name", DECLARED)
def test_its_numbers_occur_in_the_raw_table(name):
    """As they stand there or with two digits; those that stand in names for readers are words."""
    raw = (ROOT / "benchmarks" / "tables" / DECLARED[name]["raw"]).read_text(encoding="utf-8")
    known = {value(text) for text in NUMBER.findall(raw)}
    known |= {value(f"{each:.1e}") for each in known}
    words = DECLARED[name].get("names", {}).values()
    cells = [cell.strip("*") for row in made(name)[1] for cell in row]
    numbers = [value(text) for cell in cells if cell not in words for text in NUMBER.findall(cell)]
    assert set(numbers) <= known
    assert numbers or name == "eight-tasks"


@pytest.mark.parametrize("name", [name for name in DECLARED if "best" in DECLARED[name]])
def test_the_bold_numbers_are_the_best_ones(name):
    """None of those that one is compared with is better, and some number is bold."""
    rows, bold = tables.reader_table(DECLARED[name])
    assert bold
    compared = set()
    for rule in DECLARED[name]["best"]:
        sign = {"min": 1, "max": -1}[rule["pick"]]
        for at, head in bold:
            here = rows[at]
            others = [here[other] for other in rule.get("among", []) if head in rule["among"]]
            fellows = [row for row in rows if all(row[key] == here[key] for key in rule.get("within", []))]
            others += [row[head] for row in fellows if head in rule.get("of", [])]
            compared |= {(at, head)} if others else set()
            numbers = [value(text) for text in others if NUMBER.fullmatch(text)]
            assert all(sign * value(here[head]) <= sign * number for number in numbers)
    assert compared == bold
    written = {cell for row in made(name)[1] for cell in row if "**" in cell}
    assert written == {f"**{rows[at][head]}**" for at, head in bold}


def test_the_best_of_a_column_a_row_and_a_tie():
    rows = [{"a": "2", "b": "refused"}, {"a": "3", "b": "1.0e-3"}, {"a": "3", "b": ""}]
    best = {"row": {"pick": "min", "among": ["a", "b"]}, "column": {"pick": "max", "of": ["a", "b"]}}
    assert set(tables.best_cells(rows, best["row"])) == {(0, "a"), (1, "b")}
    assert set(tables.best_cells(rows, best["column"])) == {(1, "a"), (2, "a"), (1, "b")}
    assert set(tables.best_cells(rows, {**best["column"], "within": ["a"]})) == set()


@pytest.mark.parametrize(
    ("text", "style", "shown"),
    [
        ("1.34e-05", "plain", "1.3e-5"),
        ("1.34e-03", "plain", "0.0013"),
        ("1.34e-03", "power", "1.3e-3"),
        ("90,486", "plain", "90,000"),
        ("90,486", "raw", "90,486"),
        ("0e+00", "raw", "0"),
        ("1e-05 to 1e+09", "plain", "1e-5 to 1e9"),
    ],
)
def test_how_numbers_are_written(text, style, shown):
    assert tables.shown_text(text, style) == shown


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"raw": "nowhere.md"}, "there is no raw table benchmarks/tables/nowhere.md."),
        ({"table": 3}, "the raw file has no table 3."),
        ({"columns": {"error": "errour"}}, "the raw table has no column 'errour', only 'mesh', 'spacing', "),
        ({"rows": [{"mesh": "Tamarind"}]}, "no raw row has {'mesh': 'Tamarind'}."),
        ({"columns": {"h": {"from": "spacing", "take": "(x)"}}}, "'(x)' finds nothing in '0.0156' of the raw column"),
        ({"columns": {"h": {"from": "spacing", "where": {"mesh": "x"}}}}, "no raw row has anything for the column 'h'"),
        ({"columns": {f"{n}": "mesh" for n in range(8)}}, "8 columns and 5 rows are above 7 and 30."),
        ({"best": [{"pick": "min", "among": ["error"]}]}, "'best' names 'error', which is no column of the table."),
        ({"bets": []}, "'bets' is no key of a declaration."),
    ],
)
def test_what_does_not_fit_is_refused_with_a_sentence(change, sentence):
    given = {key: entry for key, entry in DECLARED["forms-meshes"].items() if key != "best"}
    with pytest.raises(tables.TableError) as refused:
        tables.markdown("forms-meshes", {**given, **change})
    assert str(refused.value).startswith(f"docs/reader_tables.toml, forms-meshes: {sentence}")


def test_too_many_rows_are_refused():
    given = {"raw": "both-forms.md", "columns": {"problem": "problem", "spacing": "spacing", "rms": "rms %, Galerkin"}}
    with pytest.raises(tables.TableError, match=r"3 columns and .* rows are above 7 and 30"):
        tables.markdown("all", given)
