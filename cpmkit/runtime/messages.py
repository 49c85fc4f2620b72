"""The accepted word that is nearest to one that is not, for messages."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from html import escape
from typing import Any

from cpmkit.errors import CpmkitWarning, printable

#: Longer words are not compared: comparing takes the product of their lengths.
MOST_WORD_CHARACTERS = 100


def did_you_mean(given: object, accepted: Iterable[str]) -> str:
    """Return `` (did you mean 'left'?)`` for a word that is nearly one of those accepted, else nothing.

    Examples
    --------
    >>> did_you_mean("lefft", ["left", "right"]), did_you_mean("top", ["left", "right"])
    (" (did you mean 'left'?)", '')
    """
    if not isinstance(given, str) or len(given) > MOST_WORD_CHARACTERS:
        return ""
    near = get_close_matches(given.lower(), list(accepted), n=1, cutoff=0.7)
    return f" (did you mean {near[0]!r}?)" if near else ""


def html_table(title: str, rows: Iterable[tuple[str, str]], picture: bytes | None = None) -> str:
    """Return a table of names and what they are, with a PNG ``picture`` above it."""
    drawn = "" if picture is None else _image(picture)
    cells = "".join(f"<tr><th style='text-align:left'>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f"<div><b>{escape(title)}</b><br>{drawn}<table>{cells}</table></div>"


def _image(picture: bytes) -> str:
    from base64 import b64encode

    return f"<img src='data:image/png;base64,{b64encode(picture).decode()}' style='max-width:100%'>"


#: The project's own plugins: each is an extra of the core, a distribution, and as a rule a family of kinds.
FAMILIES = ("analytic", "combinations", "fem", "levelset", "mesh", "parametric", "pointcloud", "svg")
#: First words of the kinds of the plugin ``combinations``, whose names do not begin with its own.
COMBINATIONS = ("cut", "moved", "points", "solid", "trimmed", "tube", "union")


def to_install(extra: str) -> str:
    """Return the command that adds an extra of cpmkit, and its like in a clone.

    >>> to_install("view")
    "`pip install 'cpmkit[view]'` (in a clone `pip install '.[view]'`)"
    >>> to_install("mesh")
    "`pip install 'cpmkit[mesh]'` (in a clone `pip install . ./plugins/cpmkit-mesh`)"
    """
    in_a_clone = f". ./plugins/cpmkit-{extra}" if extra in FAMILIES else f"'.[{extra}]'"
    if extra == "all":
        in_a_clone = "'.[view,data]' ./plugins/*"
    return f"`pip install 'cpmkit[{extra}]'` (in a clone `pip install {in_a_clone}`)"


def warn_each(sentences: Iterable[str], stacklevel: int = 2) -> None:
    """Issue each sentence as a warning, attributed to the caller ``stacklevel`` frames up."""
    for sentence in dict.fromkeys(sentences):
        warnings.warn(printable(sentence), CpmkitWarning, stacklevel=stacklevel + 1)


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect the sentences of all CpmkitWarnings of the block, each once, in place of showing them; others are shown.

    Not for several threads at a time: the filters of Python's warnings belong to the process.
    """
    heard: list[str] = []
    with warnings.catch_warnings():
        show = warnings.showwarning

        def hear(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, CpmkitWarning):
                show(message, category, *place, **more)
            elif str(message) not in heard:
                heard.append(str(message))

        warnings.simplefilter("always", CpmkitWarning)
        warnings.showwarning = hear
        yield heard
