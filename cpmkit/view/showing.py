"""Solutions on the screen: a page in a browser or a notebook, a plot of matplotlib, and a thumbnail in notebooks."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import sys
import tempfile
import webbrowser
from dataclasses import dataclass, replace
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.vector_algebra import in_three_dimensions
from cpmkit.scenefile.look import Look, LookKeywords
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.solution.frames import EvolvedRecord
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats
from cpmkit.view.colours import Bar
from cpmkit.view.drawing import fit_camera
from cpmkit.view.pictures import check_look, mode_colour_bar, picture, render, shown_values


def page_of(solution: SolutionRecord, **options: Unpack[LookKeywords]) -> str:
    """Return the HTML page of a solution, with a slider over frames in time or over modes.

    ``**options``: options of :class:`~cpmkit.scenefile.look.Look`; isolines, edges and vectors are not drawn, and the
    width is the browser's. Raises InputError if an option is not accepted or the surface has no mesh, CpmkitError if a
    requested error cannot be estimated, MissingDependencyError without matplotlib.
    """
    look = Look.from_options(options, "a page")
    check_look(look)
    mesh, fields, bar = _slider_fields(solution, look)
    camera, curves, pins = fit_camera(solution, mesh, look, 800)  # only the ratio of the width to the height matters
    points, curves, pins = (each - camera.centre for each in (in_three_dimensions(mesh.points), curves, pins))
    every = np.concatenate([points, curves.reshape(-1, 3), pins])
    data = {
        "points": _as_base64(points, "<f4"),
        "triangles": _as_base64(mesh.triangles, "<u4"),
        "segments": _as_base64(mesh.segments, "<u4"),
        "dots": _as_base64(mesh.dots, "<u4"),
        "curves": _as_base64(curves, "<f4"),
        "pins": _as_base64(pins, "<f4"),
        "fields": [{"name": name, "values": _as_base64(values, "<f4")} for name, values in fields],
        "rgb": bar is None,
        "lit": look.light == "shaded" or (look.light is None and bar is None),
        "ends": [0, 1] if bar is None else bar.ends.tolist(),
        "ticks": [] if bar is None else _bar_ticks(bar),
        "label": "" if bar is None else bar.label,
        "table": _as_base64(np.zeros((256, 3)) if bar is None else np.round(255 * bar.table), "u1"),
        "axes": camera.axes.tolist(),
        "middle": [0.0, 0.0, 0.0],
        "half": camera.half.tolist(),
        "radius": float(np.linalg.norm(every, axis=1).max()),
    }
    return _fill_template(look.title or f"{solution.scene.problem.kind}", data)


def _fill_template(title: str, data: dict[str, Any]) -> str:
    """Return the HTML page with the text ``title`` and the JSON of ``data``, each escaped, in the packaged template.

    The content security policy allows only the page's own script and style, by their hashes.
    """
    template = files("cpmkit.view").joinpath("page.html").read_text(encoding="utf-8")
    policy = []
    for tag in ("script", "style"):  # the template has one of each
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", template, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode("ascii")
        policy.append(f"{tag}-src 'sha256-{digest}'")
    texts = {
        "POLICY": "; ".join(["default-src 'none'", *policy, "base-uri 'none'", "form-action 'none'"]),
        "TITLE": escape(title),
        "DATA": json.dumps(data).translate({ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&"}),
    }
    return re.sub("__(POLICY|TITLE|DATA)__", lambda place: texts[place[1]], template)


def _slider_fields(solution: SolutionRecord, look: Look) -> tuple[DisplayMesh, list[tuple[str, Floats]], Bar | None]:
    """Return the mesh, pairs (name, values (v,) or (v, 1), or colours (v, 3)), and the bar, None with colours."""
    if isinstance(solution, EigenRecord) and look.channel is None and look.field != "error":
        mesh = solution.display_mesh()
        return mesh, list(zip(solution.titles, mesh.values.T, strict=True)), mode_colour_bar(mesh.values, look)
    look = replace(look, vectors=False, isolines=Look.isolines)
    if isinstance(solution, EvolvedRecord) and solution.frames and look.field != "error":
        meshes = solution.frame_meshes()
        every = replace(meshes[0], values=np.concatenate([mesh.values for mesh in meshes]))
        values, bar = shown_values(solution, every, look)
        names = [f"t = {frame.time:.4g}" for frame in solution.frames]
        return meshes[0], list(zip(names, np.split(values, len(meshes)), strict=True)), bar
    mesh = solution.display_mesh()
    values, bar = shown_values(solution, mesh, look)
    return mesh, [("", values)], bar


def _bar_ticks(bar: Bar) -> list[tuple[float, str]]:
    """Return up to eight ticks of a colour bar, as pairs (place on the bar from 0 to 1, text)."""
    from matplotlib.ticker import MaxNLocator

    places = [tick for tick in MaxNLocator(7).tick_values(*bar.ends) if bar.ends[0] <= tick <= bar.ends[1]]
    texts = [f"{place:.6g}" for place in places]
    return list(zip(bar.shares(np.array(places)).tolist(), texts, strict=True))


def _as_base64(array: Any, kind: str) -> str:
    """Return the bytes of an array, row by row, converted to the NumPy type ``kind``, in base 64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")


@dataclass(frozen=True)
class Page:
    """An interactive page, which a notebook displays."""

    html: str
    file: Path | None = None  #: The file of the page, if it was opened in a browser.

    def _repr_html_(self) -> str:
        page = escape(self.html, quote=True)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 520px; border: 0"></iframe>'

    def __repr__(self) -> str:
        return f"Page({'in a notebook' if self.file is None else str(self.file)!r})"


def show(solution: SolutionRecord, **options: Unpack[LookKeywords]) -> Page:
    """Show a solution as a page to turn and zoom: in a notebook below the cell, else in the browser; return the page.

    ``options`` and errors are those of :func:`page_of`. Raises InputError also if no browser opens; the file remains.
    """
    html = page_of(solution, **options)
    shell = sys.modules.get("IPython")
    if shell is not None and type(shell.get_ipython()).__name__ == "ZMQInteractiveShell":  # the kernel of a notebook
        return Page(html)
    with tempfile.NamedTemporaryFile("w", suffix=".html", prefix="cpmkit-", delete=False, encoding="utf-8") as file:
        file.write(html)
    page = Page(html, Path(file.name))
    if not webbrowser.open(Path(file.name).as_uri()):
        raise InputError(f"no browser opens here; copy {file.name} to where one does, or use solution.picture.")
    return page


def plot(solution: SolutionRecord, axes: Any = None, **options: Unpack[LookKeywords]) -> Any:
    """Draw a solution on axes of matplotlib, by default of a new figure 900 pixels wide, and return them.

    ``options`` are those of Look. Raises InputError if one is not accepted or the surface has no mesh, CpmkitError if a
    requested error cannot be estimated, and MissingDependencyError without matplotlib.
    """
    look = Look.from_options({"width": 900, **options}, "a plot", ("axes",))
    check_look(look)
    from matplotlib import pyplot

    image, _ = render(solution, look)
    if axes is None:
        rows, columns = image.shape[:2]
        axes = pyplot.figure(figsize=(columns / 100, rows / 100), layout="constrained").add_subplot()
    axes.imshow(image)
    axes.set_axis_off()
    return axes


def thumbnail(solution: SolutionRecord) -> bytes | None:
    """Return a PNG picture of a solution as bytes; None if it cannot be drawn, or has above 200,000 unknowns."""
    if len(solution.values) > 200_000:
        return None
    try:
        with tempfile.TemporaryDirectory() as folder:
            return picture(solution, Path(folder, "solution.png"), width=400).file.read_bytes()
    except Exception:  # a notebook draws without request, which must not raise
        return None
