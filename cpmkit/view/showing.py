"""Solutions on the screen: an interactive page in a browser or a notebook, and a picture on axes of matplotlib."""

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
from cpmkit.view.page import page_of
from cpmkit.view.pictures import check_look, rendered

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords
    from cpmkit.solution.record import SolutionRecord

#: Of the frame in a notebook, in pixels; and how wide a picture on axes is.
NOTEBOOK_HEIGHT, PLOT_WIDTH = 520, 900


@dataclass(frozen=True)
class Page:
    """An interactive page; a notebook shows it.

    Attributes
    ----------
    html : str
    file : Path or None
        Where it lies, if it was opened in a browser.
    """

    html: str
    file: Path | None = None

    def _repr_html_(self) -> str:
        page = escape(self.html, quote=True)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: {NOTEBOOK_HEIGHT}px; border: 0"></iframe>'

    def __repr__(self) -> str:
        return f"Page({'in a notebook' if self.file is None else str(self.file)!r})"


def show(solution: SolutionRecord, **options: Unpack[LookKeywords]) -> Page:
    """Show a solution to be turned and zoomed: in a notebook below the cell, else in a window of the browser.

    Raises
    ------
    InputError
        If there is no browser to open; the message says where the page lies.
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
    """Draw a solution on axes of matplotlib, those of a new figure unless given, and return them."""
    from matplotlib import pyplot

    look = Look.of({"width": PLOT_WIDTH, **options}, "a plot", ("axes",))
    check_look(look)
    image, _ = rendered(solution, look)
    if axes is None:
        rows, columns = image.shape[:2]
        axes = pyplot.figure(figsize=(columns / 100, rows / 100), layout="constrained").add_subplot()
    axes.imshow(image)
    axes.set_axis_off()
    return axes


def in_notebook() -> bool:
    """Tell whether this runs in the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return type(running).__name__ == "ZMQInteractiveShell"
