"""Parts of messages (spelling suggestions, installation commands, HTML tables), and warnings issued or collected."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from html import escape
from typing import Any

from cpmkit.errors import CpmkitWarning, printable


def did_you_mean(word: object, accepted: Iterable[str]) -> str:
    """Return the suggestion `` (did you mean 'left'?)`` if ``word`` resembles an accepted word, else "".

    Examples
    --------
    >>> did_you_mean("lefft", ["left", "right"]), did_you_mean("top", ["left", "right"])
    (" (did you mean 'left'?)", '')
    """
    if not isinstance(word, str) or len(word) > 100:  # the time of a comparison grows like the product of the lengths
        return ""
    matches = get_close_matches(word.lower(), list(accepted), n=1, cutoff=0.7)
    return f" (did you mean {matches[0]!r}?)" if matches else ""


def html_table(title: str, rows: Iterable[tuple[str, str]], picture: bytes | None = None) -> str:
    """Return an HTML table of ``rows`` (name, value) for notebooks, below its title and the PNG ``picture`` if any."""
    image = ""
    if picture is not None:
        from base64 import b64encode

        image = f"<img src='data:image/png;base64,{b64encode(picture).decode()}' style='max-width:100%'>"
    cells = "".join(f"<tr><th style='text-align:left'>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f"<div><b>{escape(title)}</b><br>{image}<table>{cells}</table></div>"


#: The project's own plugins: each is an extra of the core, a distribution, and usually a family of kinds.
PLUGIN_FAMILIES = ("analytic", "combinations", "fem", "levelset", "mesh", "parametric", "pointcloud", "svg")
#: First words of the kinds of the plugin ``combinations``, whose names do not begin with its own.
COMBINATIONS = ("cut", "moved", "points", "solid", "trimmed", "tube", "union")
#: Values of the option ``form``, which are easily given to another option.
FORM_NAMES = ("collocation", "galerkin")


def install_command(extra: str) -> str:
    """Return the command that installs an extra of cpmkit, and the command to use in a clone of the repository.

    >>> install_command("view")
    "`pip install 'cpmkit[view]'` (in a clone `pip install '.[view]'`)"
    >>> install_command("mesh")
    "`pip install 'cpmkit[mesh]'` (in a clone `pip install . ./plugins/cpmkit-mesh`)"
    """
    in_a_clone = f". ./plugins/cpmkit-{extra}" if extra in PLUGIN_FAMILIES else f"'.[{extra}]'"
    if extra == "all":
        in_a_clone = "'.[view,data]' ./plugins/*"
    return f"`pip install 'cpmkit[{extra}]'` (in a clone `pip install {in_a_clone}`)"


def warn_each(sentences: Iterable[str], stacklevel: int = 2) -> None:
    """Issue each different one of ``sentences`` as a CpmkitWarning of the frame ``stacklevel`` frames above.

    A ``stacklevel`` of 1 is the caller of this function.
    """
    for sentence in dict.fromkeys(sentences):
        warnings.warn(printable(sentence), CpmkitWarning, stacklevel=stacklevel + 1)


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Yield a list that collects the sentences of all CpmkitWarnings of the block, each once, instead of showing them.

    Warnings of other categories are shown. Only one thread at a time may use this context, because Python's
    warning filters belong to the process.
    """
    sentences: list[str] = []
    with warnings.catch_warnings():
        show = warnings.showwarning

        def collect(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, CpmkitWarning):
                show(message, category, *place, **more)
            elif str(message) not in sentences:
                sentences.append(str(message))

        warnings.simplefilter("always", CpmkitWarning)
        warnings.showwarning = collect
        yield sentences
