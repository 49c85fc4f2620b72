"""Sizes and names of the code, as a table.

Run ``python benchmarks/measure_house.py``; it needs ``pip install .`` and this repository's files.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: File names that several folders may have.
SHARED_NAMES = {"__init__", "form", "options", "levels"}
#: Words that stand for too much to say anything.
PRIVATE_WORDS = {"told", "tells", "held", "parted", "parting", "lent", "mended", "bent", "asked", "carried", "settled"}
#: Participles that do not end in -ed.
IRREGULAR = {
    "told", "held", "bent", "kept", "lent", "met", "left", "given", "taken", "drawn", "cut", "sent", "made",
    "found", "seen", "known", "set", "put", "read", "said", "shown", "split", "spent", "built", "felt", "lost",
    "meant", "paid", "sought", "taught", "thought", "won", "begun", "chosen", "driven", "fallen", "frozen", "grown",
    "hidden", "risen", "spoken", "thrown", "worn", "written", "woven", "run", "spun",
}  # fmt: skip
#: Modules whose names are public.
PUBLIC = ("cpmkit", "cpmkit.plugin", "cpmkit.testing", "cpmkit.errors")


def files(*folders: str) -> list[Path]:
    """Return the Python files of folders, without tests."""
    found = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return [path for path in found if "tests" not in path.relative_to(ROOT).parts and ".venv" not in path.parts]


def lines(paths: Iterable[Path]) -> int:
    """Return how many lines files have."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def words(identifier: str) -> list[str]:
    """Return the words of an identifier in small letters."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", identifier)]


def identifiers(path: Path) -> Iterator[str]:
    """Yield the names in a file's code, as often as they occur."""
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(io.StringIO(file.read()).readline):
            if token.type == tokenize.NAME:
                yield token.string


def nodes(path: Path) -> Iterator[ast.AST]:
    """Yield all nodes of a file's syntax tree."""
    return ast.walk(ast.parse(path.read_text(encoding="utf-8")))


def private_words(paths: Iterable[Path]) -> int:
    """Return how often the private words occur in identifiers."""
    return sum(not PRIVATE_WORDS.isdisjoint(words(name)) for path in paths for name in identifiers(path))


def participles(paths: Iterable[Path]) -> float:
    """Return the share of functions whose name is one participle."""
    found = [node for path in paths for node in nodes(path)]
    names = [node.name.strip("_") for node in found if isinstance(node, ast.FunctionDef)]
    alone = [name for name in names if "_" not in name and (name.endswith("ed") or name in IRREGULAR)]
    return len(alone) / len(names)


def repeated_names(paths: Iterable[Path]) -> int:
    """Return how many file names occur more than once."""
    count = Counter(path.stem for path in paths if path.stem not in SHARED_NAMES)
    return sum(number > 1 for number in count.values())


def constants(paths: Iterable[Path]) -> int:
    """Return how many names in capitals modules assign."""
    found = 0
    for path in paths:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            if not isinstance(node, ast.Assign | ast.AnnAssign):
                continue
            names = [name for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
            found += sum(name.id.isupper() for name in names)
    return found


def calls_of(paths: Iterable[Path], function: str) -> int:
    """Return how often a function is named."""
    return sum(name == function for path in paths for name in identifiers(path))


def imported(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the modules and names that a file imports from the core, anywhere in it."""
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "cpmkit":
            for alias in node.names:
                yield str(node.module), alias.name


def largest_circle(paths: Iterable[Path]) -> int:
    """Return how many files the largest circle of imports has, those for annotations and inside functions counted."""
    import numpy as np
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    module = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}
    module = {name.removesuffix(".__init__"): path for name, path in module.items()}
    number = {name: k for k, name in enumerate(module)}
    ends = []
    for name, path in module.items():
        for source, what in imported(path):
            target = f"{source}.{what}" if f"{source}.{what}" in number else source
            if target in number and target != name:
                ends.append((number[name], number[target]))
    rows, columns = np.array(ends).T
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(number),) * 2)
    return int(np.bincount(connected_components(graph, directed=True, connection="strong")[1]).max())


def internal_names(paths: Iterable[Path]) -> int:
    """Return how many different internal names files import."""
    return len({found for path in paths for found in imported(path) if found[0] not in PUBLIC})


def members(kind: type) -> int:
    """Return how many members a class and those it is made of define, those of every object aside."""
    return len({name for one in kind.__mro__ for name in vars(one) if not name.startswith("__")})


def meshes(paths: Iterable[Path]) -> int:
    """Return how many classes have fields for vertices and for cells."""
    found = 0
    for path in paths:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                fields = {
                    one.target.id
                    for one in node.body
                    if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)
                }
                found += "vertices" in fields and bool(fields & {"cells", "faces", "triangles"})
    return found


def rows() -> Iterator[tuple[str, str]]:
    """Yield what is counted, and the number."""
    from cpmkit.forms.contract import Discretized
    from cpmkit.forms.galerkin.refinement.refined import RefinedGalerkin
    from cpmkit.runtime.deprecation import DeprecatedMember

    contract = {
        name
        for kind in Discretized.__mro__
        for name, member in vars(kind).items()
        if kind.__module__ == Discretized.__module__
        and not name.startswith("_")
        and not isinstance(member, DeprecatedMember)
    }
    core, all_code = files("cpmkit"), files("cpmkit", "plugins")
    tests = [
        path
        for folder in ("tests", "plugins")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if "tests" in path.parts
    ]
    yield "lines of `cpmkit/`", f"{lines(core):,}"
    yield "files of `cpmkit/`", f"{len(core):,}"
    yield "lines of `forms/galerkin`", f"{lines(files('cpmkit/forms/galerkin')):,}"
    yield "lines of `forms/collocation`", f"{lines(files('cpmkit/forms/collocation')):,}"
    yield "public members of a form's contract", f"{len(contract)}"
    yield "types of mesh", f"{meshes(all_code)}"
    yield "members of the refined Galerkin form", f"{members(RefinedGalerkin)}"
    yield "functions named by one participle alone", f"{participles(core):.1%}"
    yield "file names used more than once", f"{repeated_names(core)}"
    yield "private words in identifiers", f"{private_words(all_code):,}"
    yield "module constants", f"{constants(core):,}"
    yield "`isinstance` in the core", f"{calls_of(core, 'isinstance')}"
    yield "largest circle of imports, files", f"{largest_circle(core)}"
    yield "internal names that tests import", f"{internal_names(tests)}"


if __name__ == "__main__":
    print("| | now |\n|---|--:|")
    for what, number in rows():
        print(f"| {what} | {number} |")
