"""An interactive page for any browser, which contains the mesh and the values of a solution and loads nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from cpmkit.scenefile.look import Look
from cpmkit.solution.frames import EvolvedRecord
from cpmkit.solution.modes import EigenRecord
from cpmkit.types import Floats
from cpmkit.view.camera import fit
from cpmkit.view.colours import Bar, make_bar
from cpmkit.view.drawing import boundary_meshes, in_space
from cpmkit.view.pictures import SIGNED_CMAP, check_look, shown_values

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords
    from cpmkit.solution.display_mesh import DisplayMesh
    from cpmkit.solution.record import SolutionRecord

#: Width of the view in pixels; only its ratio to the height matters.
WIDTH = 800


def page_of(solution: SolutionRecord, **options: Unpack[LookKeywords]) -> str:
    """Return the HTML page of a solution, with a slider over frames in time or over modes.

    Parameters
    ----------
    solution : Solution
    **options
        Options of :class:`~cpmkit.scenefile.look.Look`; isolines, edges and vectors are not drawn.
    """
    look = Look.of(options, "a page")
    check_look(look)
    mesh, fields, bar = _slider_fields(solution, look)
    points = in_space(mesh.points)
    curve_points, curve_cells, pins = boundary_meshes(
        solution.scene.boundaries if look.curves else (), solution.spacing
    )
    more = np.concatenate([curve_points, pins])
    camera = fit(points, WIDTH, look.view, look.up, mesh.points.shape[1] == 2, more)
    every = np.concatenate([points, more]) - camera.centre
    data = {
        "points": _as_base64(points - camera.centre, "<f4"),
        "triangles": _as_base64(mesh.triangles, "<u4"),
        "segments": _as_base64(mesh.segments, "<u4"),
        "dots": _as_base64(mesh.dots, "<u4"),
        "curves": _as_base64(curve_points[curve_cells] - camera.centre, "<f4"),
        "pins": _as_base64(pins - camera.centre, "<f4"),
        "fields": [{"name": name, "values": _as_base64(values, "<f4")} for name, values in fields],
        "rgb": bar is None,
        "lit": look.light == "shaded" or (look.light is None and bar is None),
        "ends": [0, 1] if bar is None else bar.ends.tolist(),
        "ticks": [] if bar is None else _ticks(bar),
        "label": "" if bar is None else bar.label,
        "table": _as_base64(np.zeros((256, 3)) if bar is None else np.round(255 * bar.table), "u1"),
        "axes": camera.axes.tolist(),
        "middle": [0.0, 0.0, 0.0],
        "half": camera.half.tolist(),
        "radius": float(np.linalg.norm(every, axis=1).max()),
    }
    return _fill_template(look.title or f"{solution.scene.problem.kind}", data)


def _fill_template(title: str, data: dict[str, Any]) -> str:
    """Return the page's template with title and data filled in, in one pass, so that neither may hold a placeholder.

    The content security policy allows only the page's own script and style, by their hashes.
    """
    template = files("cpmkit.view").joinpath("page.html").read_text(encoding="utf-8")
    policy = [f"{tag}-src {_hash_of(tag, template)}" for tag in ("script", "style")]
    texts = {
        "POLICY": "; ".join(["default-src 'none'", *policy, "base-uri 'none'", "form-action 'none'"]),
        "TITLE": escape(title),
        "DATA": json.dumps(data).translate({ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&"}),
    }
    return re.sub("__(POLICY|TITLE|DATA)__", lambda place: texts[place[1]], template)


def _hash_of(tag: str, template: str) -> str:
    """Return the hash, in the notation of a content security policy, of the content of the only plain ``<tag>``."""
    (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", template, re.DOTALL)
    return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode('ascii')}'"


def _slider_fields(solution: SolutionRecord, look: Look) -> tuple[DisplayMesh, list[tuple[str, Floats]], Bar | None]:
    """Return the mesh, the (name, values) that the slider selects from, and their colour bar, None for colours."""
    if isinstance(solution, EigenRecord) and look.channel is None:
        mesh = solution.display_mesh()
        most = float(np.abs(mesh.values).max())
        cmap = SIGNED_CMAP if look.cmap == Look.cmap else look.cmap
        signed = make_bar(mesh.values, look.clim or (-most, most), cmap, look.label, look.unit)
        return mesh, list(zip(solution.titles, mesh.values.T, strict=True)), signed
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


def _ticks(bar: Bar) -> list[tuple[float, str]]:
    """Return the ticks of a colour bar: the place of each from 0 to 1, and its text."""
    from matplotlib.ticker import MaxNLocator

    places = [tick for tick in MaxNLocator(7).tick_values(*bar.ends) if bar.ends[0] <= tick <= bar.ends[1]]
    texts = [f"{place:.6g}" for place in places]
    return list(zip(bar.shares(np.array(places)).tolist(), texts, strict=True))


def _as_base64(array: Any, kind: str) -> str:
    """Return the bytes of an array, converted to the type ``kind``, in base 64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")
