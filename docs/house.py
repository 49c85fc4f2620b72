"""The rooms of the house and what they import, read off the code: for the page "How the code is laid out".

``python docs/house.py`` prints the list; the documentation's build calls :func:`write_all`.
"""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
#: The form whose inside is drawn, too.
FORMS = ("collocation", "galerkin")
#: What it shows to type checkers, it imports when it is asked for.
FACADE = "cpmkit.plugin"
#: Texts that are the name of a module and mean a group of entry points.
ENTRY_POINT_GROUPS = ("cpmkit.commands",)
#: Nodes of a syntax tree that import nothing, and hold none that do.
LEAVES = (ast.Name, ast.arg, ast.expr_context, ast.operator, ast.unaryop, ast.boolop, ast.cmpop)


@dataclass(frozen=True)
class Import:
    """One file importing another, by the names of their modules; ``late`` ones stand inside a function."""

    importer: str
    imported: str
    late: bool


@cache
def modules() -> dict[str, Path]:
    """Return the file of each module of cpmkit, but for ``__main__``, which is another name of the command."""
    files = sorted(file for file in (ROOT / "cpmkit").rglob("*.py") if file.name != "__main__.py")
    names = [".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for file in files]
    return dict(zip(names, files, strict=True))


@cache
def imports() -> tuple[Import, ...]:
    """Return all imports between modules, those inside functions too; not those for type checkers alone."""
    return tuple(found for name, file in modules().items() for found in _imports_of(name, file))


def _imports_of(name: str, file: Path) -> Iterator[Import]:
    waiting = [(node, False) for node in ast.parse(file.read_text(encoding="utf-8")).body]
    while waiting:
        node, late = waiting.pop()
        typed = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        if typed and name != FACADE:
            continue
        yield from (Import(name, target, late) for target in _targets(node) if target != name)
        inside = late or isinstance(node, (ast.FunctionDef, ast.Lambda))
        waiting += [(child, inside) for child in ast.iter_child_nodes(node) if not isinstance(child, LEAVES)]


def _targets(node: ast.AST) -> Iterator[str]:
    """Yield the modules that a statement imports; a module's full name in quotes is one that is imported by name."""
    if isinstance(node, ast.ImportFrom) and node.module:
        for one in node.names:
            inner = f"{node.module}.{one.name}"
            public = _public().get(one.name) if node.module == "cpmkit" else None
            found = inner if inner in modules() else public or node.module
            if found in modules():
                yield found
    elif isinstance(node, ast.Import):
        yield from (one.name for one in node.names if one.name in modules() and one.name != "cpmkit")
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "ck":
        yield from {_public()[node.attr]} if node.attr in _public() else ()
    elif isinstance(node, ast.Constant) and node.value in modules() and "." in node.value:
        if node.value in ENTRY_POINT_GROUPS:
            return
        yield node.value


@cache
def _public() -> dict[str, str]:
    """Return the modules that hold the public names of cpmkit, which it imports on first use."""
    tree = ast.parse(modules()["cpmkit"].read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    return {one.name: node.module for node in block.body for one in node.names}


@cache
def rooms() -> tuple[str, ...]:
    """Return the rooms from the line down to the ground, as the contract in pyproject.toml lists them."""
    return tuple(layer.removeprefix("cpmkit.") for layer in _contract()["layers"])


def _contract() -> dict[str, list[str]]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    return next(contract for contract in contracts if contract["type"] == "layers")


@cache
def faces() -> frozenset[tuple[str, str]]:
    """Return the pairs of modules of which the first may import the second although it stands above it."""
    pairs = [allowed.split(" -> ") for allowed in _contract().get("ignore_imports", [])]
    return frozenset((importer, imported) for importer, imported in pairs)


def room_of(module: str) -> str:
    """Return the room of a module: the package or the file directly in cpmkit that it is, or is in."""
    return module.split(".")[1] if "." in module else "cpmkit"


@cache
def package_of(module: str) -> str:
    """Return the innermost package of a module; the module itself where that package holds further packages."""
    if modules()[module].name == "__init__.py":
        return module
    package = module.rpartition(".")[0]
    here = modules()[package].parent
    holds = any(file.name == "__init__.py" and file.parents[1] == here for file in modules().values())
    return module if holds else package


def arrows(named: Callable[[str], str] = room_of, upwards: bool = False) -> set[tuple[str, str]]:
    """Return which rooms, or what ``named`` makes of modules, import which others: the faces ``upwards``, or the rest.

    The package cpmkit itself is left out: it imports what it is asked for.
    """
    chosen = {(one.importer, one.imported) for one in imports() if one.importer != "cpmkit"}
    chosen = chosen & faces() if upwards else chosen - faces()
    pairs = {(named(importer), named(imported)) for importer, imported in chosen}
    return {(importer, imported) for importer, imported in pairs if importer != imported}


def arrows_inside(package: str) -> set[tuple[str, str]]:
    """Return which packages and files directly in a package import which others of them."""
    inside = f"{package}."
    pairs = {pair for pair in arrows(package_of) if all(name.startswith(inside) for name in pair)}
    return {(importer.removeprefix(inside), imported.removeprefix(inside)) for importer, imported in pairs}


def cycle(pairs: set[tuple[str, str]]) -> list[str]:
    """Return a way from a name back to itself along ``pairs``, empty where there is none."""
    following: dict[str, list[str]] = {}
    for first, second in sorted(pairs):
        following.setdefault(first, []).append(second)
    done: set[str] = set()

    def search(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return []
        done.add(name)
        return next((found for after in following.get(name, []) if (found := search(after, [*way, name]))), [])

    return next((found for name in sorted(following) if (found := search(name, []))), [])


def sentence(file: Path) -> str:
    """Return the first line of a module's docstring, with code marked as Markdown marks it."""
    docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0].replace("``", "`")


def rooms_table() -> str:
    """Return the rooms from the line down to the ground with their sentences, those in them, and the plugins."""
    lines = ["| room | what it holds | files |", "|---|---|--:|"]
    for room in rooms():
        inner = [name for name, file in modules().items() if file.name == "__init__.py" and room_of(name) == room]
        for name in inner or [f"cpmkit.{room}"]:
            inside = [other for other in modules() if other == name or other.rpartition(".")[0] == name]
            own = [other for other in inside if other not in inner or other == name]
            path = name.removeprefix("cpmkit.").replace(".", "/")
            lines.append(f"| `{path}{'/' if inner else '.py'}` | {sentence(modules()[name])} | {len(own)} |")
    for init in sorted(ROOT.glob("plugins/*/cpmkit_*/__init__.py")):
        name, files = init.parts[-3], len(list(init.parent.rglob("*.py")))
        lines.append(f"| `plugins/{name}/` | {sentence(init)} | {files} |")
    return "\n".join(lines) + "\n"


def write_all(folder: Path) -> list[Path]:
    """Write the table of the rooms and the pictures into ``folder``, and return the files.

    Raises
    ------
    ValueError
        If imports lead from a package back to it: there is no above and below then.
    """
    from house_drawing import draw_house

    if back := cycle(arrows(package_of)):
        raise ValueError(f"imports lead back: {' -> '.join(back)}; move what ties them together below both.")

    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "rooms.md"
    table.write_text(rooms_table(), encoding="utf-8")
    house = draw_house(arrows(), arrows(upwards=True), rooms(), folder / "rooms.png")
    return [table, house, *(_draw_form(form, folder / f"{form}.png") for form in FORMS)]


def _draw_form(form: str, file: Path) -> Path:
    """Draw the packages and files of a form."""
    from house_drawing import draw_house

    inner = arrows_inside(f"cpmkit.forms.{form}")
    return draw_house(inner, set(), sorted({name for pair in inner for name in pair}), file)


if __name__ == "__main__":
    print(rooms_table())
    for importer, imported in sorted(arrows(package_of)):
        print(f"{importer} -> {imported}")
    print("round about:", " -> ".join(cycle(arrows(package_of))) or "nothing")
