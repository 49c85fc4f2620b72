"""Tables of figures as HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape


def html_table(title: str, rows: Iterable[tuple[str, str]], picture: bytes | None = None) -> str:
    """Return a table of names and what they are, with a PNG ``picture`` above it."""
    drawn = "" if picture is None else _image(picture)
    cells = "".join(f"<tr><th style='text-align:left'>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f"<div><b>{escape(title)}</b><br>{drawn}<table>{cells}</table></div>"


def _image(picture: bytes) -> str:
    from base64 import b64encode

    return f"<img src='data:image/png;base64,{b64encode(picture).decode()}' style='max-width:100%'>"
