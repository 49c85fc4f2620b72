"""Warnings of a solve, issued through Python's own machinery in one category."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from cpmkit.errors import CpmkitWarning, printable


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
