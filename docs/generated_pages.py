"""Pages that are read off the code: kinds with their keys, commands, what a plugin may import, the gallery's files."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from cpmkit import plugin, plugins
from cpmkit.cli import main

ROOT = Path(__file__).parent.parent
API, GALLERY = ROOT / "docs" / "reference" / "api.md", ROOT / "docs" / "gallery.md"
#: Of the files that make the pictures of the gallery, by their suffixes.
LANGUAGES = {".toml": "toml", ".py": "python", ".svg": "xml"}
#: What carries no docstring.
DATA = {
    "Bools": "A NumPy array of bool.",
    "COORDINATES": "The names of the coordinates in formulas of position.",
    "Data": "A number, one entry a channel, or a callable of points (n, d) and, if it has a parameter t, of the time.",
    "FUNCTIONS": "The functions that formulas offer, by name.",
    "Floats": "A NumPy array of float64.",
    "Ints": "A NumPy array of int64.",
    "Law": "Any of the standard laws.",
    "MOST_EDGES": "Edge numbers of a source are below this bound, unless it has an attribute ``edge_limit``.",
    "OneSided": "Any of the standard laws but Interface.",
    "Progress": "A callable that gets the name of a stage and the share of it that is done, from 0 to 1.",
    "SIDES": "Both sides, left first.",
    "Side": '``"left"`` or ``"right"``.',
    "Surface": "A surface that scenes accept: a closest point source, an object with vertices and faces, or this pair.",
}


def write_all(folder: Path) -> list[Path]:
    """Write every page into ``folder``, which is made if need be, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = {"kinds.md": kinds_page(), "cli.md": commands_page(), "plugin-api.md": facade_page(), **gallery_listings()}
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in pages]


def gallery_listings() -> dict[str, str]:
    """Return, by the name of the page that the gallery includes, the text of each example that it names, folded."""
    named = dict.fromkeys(re.findall(r"`(examples/[^`]+)`", GALLERY.read_text(encoding="utf-8")))
    return {f"gallery-{Path(name).name}.md": _listing(name) for name in named}


def _listing(name: str) -> str:
    text = (ROOT / name).read_text(encoding="utf-8").rstrip()
    listing = f"```{LANGUAGES[Path(name).suffix]}\n{text}\n```"
    return f"<details><summary><code>{name}</code></summary>\n\n{listing}\n\n</details>\n"


def kinds_page() -> str:
    """Return a section for each installed kind, under a heading for each distribution."""
    parts, distribution = [], ""
    for kind in plugins.installed_kinds():
        if kind.distribution != distribution:
            distribution = kind.distribution
            parts.append(f"## {distribution}\n")
        parts.append(_kind(kind.kind, plugins.any_factory(kind.kind)[1]))
    return "\n".join(parts)


def _kind(kind: str, factory: Callable[..., Any]) -> str:
    rows = ["| key | if left out |", "|---|---|"]
    for name, parameter in inspect.signature(factory).parameters.items():
        rows.append(f"| `{name}` | {_default(parameter.default)} |")
    name = f"{factory.__module__}.{factory.__qualname__}"
    return "\n".join([f"### `{kind}`\n", *rows, "", "```{eval-rst}", f".. autofunction:: {name}", "```\n"])


def _default(value: Any) -> str:
    if value is inspect.Parameter.empty:
        return "must be given"
    if value is None:
        return "none"
    return f"`{list(value) if isinstance(value, tuple) else value!r}`"


def commands_page() -> str:
    """Return the help text of ``cpmkit`` and of each of its commands."""
    context = click.Context(main, info_name="cpmkit", max_content_width=100)
    parts = ["## `cpmkit`\n", _help(context)]
    parts += _commands(main, context, "cpmkit")
    return "\n".join(parts)


def _commands(group: click.Group, context: click.Context, path: str) -> list[str]:
    """Return the help texts of a group's commands, and of theirs where they are groups."""
    parts = []
    for name, command in group.commands.items():
        own = click.Context(command, parent=context, info_name=name)
        parts += [f"## `{path} {name}`\n", _help(own)]
        if isinstance(command, click.Group):
            parts += _commands(command, own, f"{path} {name}")
    return parts


def _help(context: click.Context) -> str:
    return f"```text\n{context.command.get_help(context)}\n```\n"


def facade_page() -> str:
    """Return a section for each use of the names that a plugin may import."""
    parts = []
    for use, names in plugin.USES.items():
        entries = "\n\n".join(map(_of_facade, names))
        parts.append(f"## {use}\n\n```{{eval-rst}}\n{entries}\n```\n")
    return "\n".join(parts)


def _of_facade(name: str) -> str:
    """Return a name's documentation, or the link to where the page on Python has it."""
    value, target = getattr(plugin, name), f"cpmkit.plugin.{name}"
    if name in DATA:
        return f".. py:data:: {target}\n\n   {DATA[name]}"
    sort = ("exc" if issubclass(value, Exception) else "class") if inspect.isclass(value) else "func"
    there = re.search(rf"^\.\. auto\w+:: (cpmkit\.(?:\w+\.)*{name})$", API.read_text(encoding="utf-8"), re.MULTILINE)
    if there:
        return f"``{name}`` is :py:{sort}:`{there[1]}`."
    if sort == "func":
        return f".. autofunction:: {target}"
    calls = "\n   :special-members: __call__" if "__call__" in vars(value) else ""
    return f".. autoclass:: {target}\n   :members:{calls}"
