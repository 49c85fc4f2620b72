"""Solutions on the screen: a page in a browser or a notebook, a plot of matplotlib, and a thumbnail in notebooks."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from cpmkit.errors import InputError
from cpmkit.scenefile.look import Look
from cpmkit.view import picture
from cpmkit.view.page import page_of
from cpmkit.view.pictures import check_look, render

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords
    from cpmkit.solution.record import SolutionRecord


#: Height of the frame in a notebook, and width of a picture on axes, in pixels.
NOTEBOOK_HEIGHT, PLOT_WIDTH = 520, 900


@dataclass(frozen=True)
class Page:
    """An interactive page, which a notebook displays.

    Attributes
    ----------
    html : str
    file : Path or None
        The file of the page, if it was opened in a browser.
    """

    html: str
    file: Path | None = None

    def _repr_html_(self) -> str:
        page = escape(self.html, quote=True)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: {NOTEBOOK_HEIGHT}px; border: 0"></iframe>'

    def __repr__(self) -> str:
        return f"Page({'in a notebook' if self.file is None else str(self.file)!r})"


def show(solution: SolutionRecord, **options: Unpack[LookKeywords]) -> Page:
    """Show a solution as a page to turn and zoom: in a notebook below the cell, else in the browser; return the page.

    Raises
    ------
    InputError
        If no browser can be opened; the message names the file of the page.
    """
    html = page_of(solution, **options)
    if in_notebook():
        return Page(html)
    with tempfile.NamedTemporaryFile("w", suffix=".html", prefix="cpmkit-", delete=False, encoding="utf-8") as file:
        file.write(html)
    page = Page(html, Path(file.name))
    if not webbrowser.open(Path(file.name).as_uri()):
        raise InputError(f"no browser opens here; copy {file.name} to where one does, or use solution.picture.")
    return page


def plot(solution: SolutionRecord, axes: Any = None, **options: Unpack[LookKeywords]) -> Any:
    """Draw a solution on axes of matplotlib, by default those of a new figure, and return them."""
    from matplotlib import pyplot

    look = Look.of({"width": PLOT_WIDTH, **options}, "a plot", ("axes",))
    check_look(look)
    image, _ = render(solution, look)
    if axes is None:
        rows, columns = image.shape[:2]
        axes = pyplot.figure(figsize=(columns / 100, rows / 100), layout="constrained").add_subplot()
    axes.imshow(image)
    axes.set_axis_off()
    return axes


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return type(running).__name__ == "ZMQInteractiveShell"


#: Width of a thumbnail in pixels, and the most unknowns of a solution that is drawn without request: larger ones take
#: long.
THUMBNAIL_PIXELS, MOST_DRAWN_UNKNOWNS = 400, 200_000


def thumbnail(solution: SolutionRecord) -> bytes | None:
    """Return a PNG picture of a solution as bytes; None if it cannot be drawn, or is too large to be drawn quickly."""
    if len(solution.values) > MOST_DRAWN_UNKNOWNS:
        return None
    try:
        with tempfile.TemporaryDirectory() as folder:
            return picture(solution, Path(folder, "solution.png"), width=THUMBNAIL_PIXELS).file.read_bytes()
    except Exception:  # a notebook draws without request, which must not raise
        return None
