"""A small picture of a solution for notebooks, where one can be drawn."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from cpmkit.view import picture

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord

#: Pixels of its width, and the most unknowns of which one is drawn unasked: larger ones take long.
THUMBNAIL_PIXELS, MOST_DRAWN_UNKNOWNS = 400, 200_000


def thumbnail(solution: SolutionRecord) -> bytes | None:
    """Return a PNG; None where no renderer answers, or the solution has nothing to draw or is large."""
    if len(solution.values) > MOST_DRAWN_UNKNOWNS:
        return None
    try:
        with tempfile.TemporaryDirectory() as folder:
            return picture(solution, Path(folder, "solution.png"), width=THUMBNAIL_PIXELS).file.read_bytes()
    except Exception:  # what a notebook shows unasked never fails
        return None
