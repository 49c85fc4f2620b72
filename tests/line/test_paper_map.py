"""The table from the paper to the code leads to functions that exist, in files that cite the equation."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "contributing" / "code-layout.md"
PLACE = re.compile(r"`([\w/-]+\.py)`(?:: ((?:`[\w.]+`(?:, )?)+))?")
#: Equations of the paper: 23 have their place in the code, 4 are said to have none.
LAST, ABSENT = 27, {6, 25, 26, 27}


def numbers(text):
    """Return the equations that ``text`` names."""
    return {int(number) for number in re.findall(r"eq\. (\d+)", text)}


@cache
def source(file):
    return (ROOT / ("" if file.startswith("plugins/") else "cpmkit") / file).read_text(encoding="utf-8")


@cache
def cited(file):
    """Return the equations of the paper that the lines of a file cite."""
    return set().union(*(numbers(line) for line in source(file).splitlines() if "King et al. (2024)" in line))


@cache
def defined(file):
    """Return the functions and classes of a file, and the methods of these as ``Class.method``."""
    kinds = (ast.FunctionDef, ast.ClassDef)
    outer = [node for node in ast.parse(source(file)).body if isinstance(node, kinds)]
    inner = [f"{node.name}.{one.name}" for node in outer for one in node.body if isinstance(one, kinds)]
    return {*(node.name for node in outer), *inner}


def rows():
    """Return the rows of the table: what the paper calls it, its number, and the places (file, names)."""
    table = PAGE.read_text(encoding="utf-8").partition("| paper | what it is |")[2].partition("\n\n")[0]
    found = []
    for line in table.splitlines()[2:]:
        symbol, _, number, where = (cell.strip() for cell in line.strip("|").split(" | "))
        places = [(file, re.findall(r"[\w.]+", names)) for file, names in PLACE.findall(where)]
        found.append(pytest.param(number, places, id=f"{number}: {symbol}"))
    return found


ROWS = rows()


@pytest.mark.parametrize(("number", "places"), ROWS)
def test_a_row_leads_to_functions_that_exist_in_files_that_cite_its_equation(number, places):
    assert re.fullmatch(r"((eq\.|section) [\d.]+(, )?)+", number)
    assert places or numbers(number) <= ABSENT
    for file, names in places:
        assert set(names) <= defined(file), file
        assert numbers(number) <= cited(file), file


def test_every_equation_of_the_paper_has_a_row_or_is_said_to_be_absent():
    named = set().union(*(numbers(row.values[0]) for row in ROWS if row.values[1]))
    assert named == set(range(1, LAST + 1)) - ABSENT


def test_every_equation_that_the_code_cites_has_a_row_with_a_place():
    """A number that is written wrongly, or an equation of another paper, would show here."""
    files = [*(ROOT / "cpmkit").rglob("*.py"), *(ROOT / "plugins").glob("*/cpmkit_*/*.py")]
    lines = [line for file in files for line in file.read_text(encoding="utf-8").splitlines()]
    assert set().union(*(numbers(line) for line in lines if "King et al." in line)) == set(range(1, LAST + 1)) - ABSENT


def test_citations_are_written_in_one_way():
    files = [*(ROOT / "cpmkit").rglob("*.py"), *(ROOT / "plugins").glob("*/cpmkit_*/*.py")]
    for file in files:
        for line in file.read_text(encoding="utf-8").splitlines():
            if "King et al" in line:
                assert re.search(r"King et al\. \(2024\)(,|:) ", line), (file, line)
