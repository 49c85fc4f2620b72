"""The OpenGL renderer, run as a process of its own: ``python -m cpmkit.view.opengl DRAWING.npz PICTURE.png``.

VTK does not raise where no OpenGL answers: it ends the process. So that this never takes a solved
problem with it, the parent hands over a file and judges by the picture that comes back.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.view.drawing import AMBIENT, CURVE_RADIUS, INK, LIGHT, PIN_RADIUS, STROKE_RADIUS, Drawing


def render(drawing: Drawing, path: Path) -> None:
    """Draw and write a PNG file.

    Raises
    ------
    RuntimeError
        If the renderer answered with an empty picture.
    """
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=drawing.pixels.tolist(), lighting="none")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    plotter.add_light(pyvista.Light(position=LIGHT, light_type="camera light"))
    rgb = np.round(255 * drawing.colours).astype(np.uint8)
    if len(drawing.triangles):
        _add(plotter, _surface(drawing, rgb), scalars="rgb", rgb=True)
    if len(drawing.segments):
        strokes = _tubes(drawing.points, drawing.segments, STROKE_RADIUS * drawing.half[0], rgb)
        _add(plotter, strokes, scalars="rgb", rgb=True)
    if len(drawing.curve_cells):
        _add(plotter, _tubes(drawing.curve_points, drawing.curve_cells, CURVE_RADIUS * drawing.half[0]), color=INK)
    if len(drawing.pins):
        ball = pyvista.Sphere(radius=PIN_RADIUS * drawing.half[0])
        _add(plotter, pyvista.PolyData(drawing.pins).glyph(geom=ball, scale=False, orient=False), color=INK)
    _aim(plotter, drawing)
    image = plotter.screenshot(str(path), return_img=True)
    plotter.close()
    if np.ptp(image) == 0:
        path.unlink()
        raise RuntimeError("the renderer drew an empty picture")


def _add(plotter: Any, mesh: Any, **how: Any) -> None:
    actor = plotter.add_mesh(mesh, ambient=AMBIENT, diffuse=1 - AMBIENT, specular=0.0, show_scalar_bar=False, **how)
    # Not smooth_shading=True: that computes normals anew, from the mesh that the boundaries have cut.
    actor.prop.interpolation = "Phong"


def _surface(drawing: Drawing, rgb: Any) -> Any:
    import pyvista

    mesh = pyvista.PolyData(drawing.points, faces=np.insert(drawing.triangles, 0, 3, axis=1).ravel())
    mesh.point_data["rgb"] = rgb
    if len(drawing.normals):
        mesh.point_data.active_normals = drawing.normals
    return mesh


def _tubes(points: Floats, cells: Ints, radius: float, rgb: Any = None) -> Any:
    """Return the surface of tubes of ``radius`` around the curves that the segments ``cells`` (m, 2) form."""
    import pyvista

    lines = pyvista.PolyData(points, lines=np.insert(cells, 0, 2, axis=1).ravel())
    if rgb is not None:
        lines.point_data["rgb"] = rgb
    return lines.strip(max_length=len(cells) + 1).tube(radius=radius, n_sides=24, capping=True)


def _aim(plotter: Any, drawing: Drawing) -> None:
    camera = plotter.camera
    distance = 10 * float(np.ptp(drawing.points, axis=0).max() + drawing.half.max())
    camera.position = drawing.centre + distance * drawing.axes[2]
    camera.focal_point = drawing.centre
    camera.up = drawing.axes[1]
    camera.parallel_projection = True
    camera.parallel_scale = float(drawing.half[1])
    plotter.reset_camera_clipping_range()


if __name__ == "__main__":
    render(Drawing.load(Path(sys.argv[1])), Path(sys.argv[2]))
