"""Sizes and names of the code, as a table: ``python tests/line/measure_house.py``.

It needs ``pip install . ./plugins/*`` and this repository's files. ``test_house_bounds.py`` bounds some of the numbers.
"""

from __future__ import annotations

import ast
import importlib
import io
import pkgutil
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

ROOT = Path(__file__).resolve().parents[2]
#: File names that several folders may have.
SHARED_NAMES = {"__init__", "form", "options", "levels"}
#: Words with a private meaning, for which the field has a term.
PRIVATE_WORDS = {"told", "tells", "held", "parted", "parting", "lent", "mended", "bent", "asked", "carried", "settled"}
#: Participles that do not end in -ed.
IRREGULAR = {
    "told", "held", "bent", "kept", "lent", "met", "left", "given", "taken", "drawn", "cut", "sent", "made",
    "found", "seen", "known", "set", "put", "read", "said", "shown", "split", "spent", "built", "felt", "lost",
    "meant", "paid", "sought", "taught", "thought", "won", "begun", "chosen", "driven", "fallen", "frozen", "grown",
    "hidden", "risen", "spoken", "thrown", "worn", "written", "woven", "run", "spun",
}  # fmt: skip
#: Modules whose names are public.
PUBLIC = ("cpmkit", "cpmkit.plugin", "cpmkit.testing", "cpmkit.errors", "cpmkit.applications", "cpmkit.view")
#: Spacing of the two small solves in which a condition is followed, and the longest sequence that is searched for one.
TRIP_SPACING, SEARCHED_ENTRIES = 0.1, 20


def python_files(*folders: str, root: Path = ROOT) -> list[Path]:
    """Return the Python files of folders, without tests."""
    paths = [path for folder in folders for path in sorted((root / folder).rglob("*.py"))]
    return [path for path in paths if "tests" not in path.relative_to(root).parts and ".venv" not in path.parts]


def test_files() -> list[Path]:
    """Return the Python files of all tests, the plugins' among them."""
    paths = [path for folder in ("tests", "plugins") for path in sorted((ROOT / folder).rglob("*.py"))]
    return [path for path in paths if "tests" in path.parts and ".venv" not in path.parts]


def count_lines(paths: Iterable[Path]) -> int:
    """Return the number of lines of files."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def words_of(identifier: str) -> list[str]:
    """Return the words of an identifier in small letters: of ``asked_Tolerance2`` asked, tolerance, 2."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", identifier)]


def identifiers(path: Path) -> Iterator[str]:
    """Yield the names in a file's code, as often as they occur."""
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(io.StringIO(file.read()).readline):
            if token.type == tokenize.NAME:
                yield token.string


def syntax_nodes(path: Path) -> Iterator[ast.AST]:
    """Yield all nodes of a file's syntax tree."""
    return ast.walk(ast.parse(path.read_text(encoding="utf-8")))


def private_names(paths: Iterable[Path]) -> Counter[str]:
    """Return the identifiers that have a private word in them, with how often they occur."""
    return Counter(name for path in paths for name in identifiers(path) if not PRIVATE_WORDS.isdisjoint(words_of(name)))


def participle_share(paths: Iterable[Path]) -> float:
    """Return the share of functions whose name is a single participle."""
    functions = [node for path in paths for node in syntax_nodes(path) if isinstance(node, ast.FunctionDef)]
    names = [function.name.strip("_") for function in functions]
    participles = [name for name in names if "_" not in name and (name.endswith("ed") or name in IRREGULAR)]
    return len(participles) / len(names)


def repeated_file_names(paths: Iterable[Path]) -> dict[str, int]:
    """Return the file names that occur more than once, with how often."""
    count = Counter(path.stem for path in paths if path.stem not in SHARED_NAMES)
    return {name: number for name, number in count.items() if number > 1}


def count_constants(paths: Iterable[Path]) -> int:
    """Return how many names in capitals are assigned by modules."""
    total = 0
    for path in paths:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            if not isinstance(node, ast.Assign | ast.AnnAssign):
                continue
            names = [name for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
            total += sum(name.id.isupper() for name in names)
    return total


def count_name(paths: Iterable[Path], function: str) -> int:
    """Return how often a function is named."""
    return sum(name == function for path in paths for name in identifiers(path))


def core_imports(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the modules and names that a file imports from the core, anywhere in it."""
    for node in syntax_nodes(path):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "cpmkit":
            for alias in node.names:
                yield str(node.module), alias.name


def largest_circle(paths: Iterable[Path]) -> list[str]:
    """Return the modules of the largest circle of imports, those for annotations and inside functions counted."""
    import numpy as np
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    modules = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}
    number = {name: k for k, name in enumerate(modules)}
    edges = []
    for name, path in modules.items():
        for module, imported in core_imports(path):
            target = f"{module}.{imported}" if f"{module}.{imported}" in number else module
            if target in number and target != name:
                edges.append((number[name], number[target]))
    rows, columns = np.array(edges).T
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(number),) * 2)
    component = connected_components(graph, directed=True, connection="strong")[1]
    largest = np.bincount(component).argmax()
    return [name for name, k in number.items() if component[k] == largest]


def internal_names(paths: Iterable[Path]) -> set[tuple[str, str]]:
    """Return the internal names that files import, each with its module."""
    return {pair for path in paths for pair in core_imports(path) if pair[0] not in PUBLIC}


def count_members(kind: type) -> int:
    """Return how many members a class and its bases define, those of ``object`` and double underscores aside."""
    return len({name for base in kind.__mro__ for name in vars(base) if not name.startswith("__")})


def contract_members() -> set[str]:
    """Return the public members of the contract of a form: of all classes of its module together."""
    from cpmkit.plugin import Discretized
    from cpmkit.runtime.deprecation import DeprecatedMember

    return {
        name
        for kind in Discretized.__mro__
        if kind.__module__ == Discretized.__module__
        for name, member in vars(kind).items()
        if not name.startswith("_") and not isinstance(member, DeprecatedMember)
    }


def galerkin_members() -> int:
    """Return the number of members of the Galerkin form, of the class of it that has most."""
    import cpmkit.forms.galerkin
    from cpmkit.plugin import Discretized

    package = cpmkit.forms.galerkin
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
    kinds, waiting = [], [Discretized]
    while waiting:
        waiting += (kind := waiting.pop()).__subclasses__()
        kinds.append(kind)
    return max(count_members(kind) for kind in kinds if kind.__module__.startswith(package.__name__))


def count_mesh_types(paths: Iterable[Path]) -> int:
    """Return how many classes have fields for vertices and for cells that are more than their numbers."""
    count = 0
    for path in paths:
        for node in syntax_nodes(path):
            if isinstance(node, ast.ClassDef):
                entries = [entry for entry in node.body if isinstance(entry, ast.AnnAssign)]
                annotated = [entry.target for entry in entries if ast.unparse(entry.annotation) != "int"]
                fields = {target.id for target in annotated if isinstance(target, ast.Name)}
                count += "vertices" in fields and bool(fields & {"cells", "faces", "triangles"})
    return count


def files_of_condition(form: str) -> set[str]:
    """Return the files of the core on the way of a condition into the matrix and the right-hand side.

    A circle is cut at a point with Dirichlet conditions on both sides, and its linear system is assembled by ``form``
    while every call is watched. A file counts where one of its functions has the condition or its law at hand: as an
    argument, in a local variable, or as its result, alone or in a sequence or mapping of up to 20 entries. Functions
    that see it only inside a scene or a boundary, and pass that on, do not count.
    """
    import cpmkit as ck
    from cpmkit.plugin import Condition, Law, Support

    kinds = (Condition, *get_args(Law), Support)
    files: set[str] = set()
    core = str(ROOT / "cpmkit")

    def holds(value: Any, depth: int = 1) -> bool:
        if isinstance(value, kinds):
            return True
        entries = list(value.values()) if isinstance(value, dict) else value
        if not depth or not isinstance(entries, list | tuple) or len(entries) > SEARCHED_ENTRIES:
            return False
        return any(holds(entry, depth - 1) for entry in entries)

    def watch(frame: Any, event: str, result: Any) -> None:
        file = frame.f_code.co_filename
        if event in ("call", "return") and file.startswith(core) and file not in files:
            values = [*frame.f_locals.values(), *([result] if event == "return" else [])]
            if any(map(holds, values)):
                files.add(file)

    def assemble() -> None:
        cut = ck.source("analytic.point", at=[1, 0])
        boundary = ck.Boundary("cut", cut, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
        scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0), [boundary])
        ck.assemble(ck.discretize(scene, TRIP_SPACING, form=form, progress=False))

    assemble()  # imports and compiles; what is seen of that is not the condition's way
    sys.setprofile(watch)
    try:
        assemble()
    finally:
        sys.setprofile(None)
    return {str(Path(file).relative_to(ROOT)) for file in files}


def rows() -> Iterator[tuple[str, str]]:
    """Yield the label and the number of each row of the table."""
    core, all_code = python_files("cpmkit"), python_files("cpmkit", "plugins")
    yield "lines of `cpmkit/`", f"{count_lines(core):,}"
    yield "files of `cpmkit/`", f"{len(core):,}"
    yield "lines of `forms/galerkin`", f"{count_lines(python_files('cpmkit/forms/galerkin')):,}"
    yield "lines of `forms/collocation`", f"{count_lines(python_files('cpmkit/forms/collocation')):,}"
    yield "public members of a form's contract, all three together", f"{len(contract_members())}"
    yield "members of the refined Galerkin form", f"{galerkin_members()}"
    yield "types of mesh in core and plugins", f"{count_mesh_types(all_code)}"
    yield "functions named by one participle alone", f"{participle_share(core):.1%}"
    yield "file names used more than once", f"{len(repeated_file_names(core))}"
    yield "private words in identifiers of core and plugins", f"{private_names(all_code).total():,}"
    yield "module constants", f"{count_constants(core):,}"
    yield "`isinstance` in the core", f"{count_name(core, 'isinstance')}"
    yield "largest circle of imports, files", f"{len(largest_circle(core))}"
    yield "different internal names that tests import", f"{len(internal_names(test_files()))}"
    trips = [len(files_of_condition(form)) for form in ("galerkin", "collocation")]
    yield "files on the way of a condition to a matrix row, Galerkin / collocation", " / ".join(map(str, trips))


if __name__ == "__main__":
    print("| | now |\n|---|--:|")
    for label, number in rows():
        print(f"| {label} | {number} |")
