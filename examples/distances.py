"""Geodesic distances with their isolines and shortest paths, on a triangle mesh and on a level set.

python examples/distances.py spot distances-spot.png        (needs spot.obj: docs/how-to/read-a-mesh.md)
python examples/distances.py dziuk distances-dziuk.png
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

import cpmkit as ck
from cpmkit.applications import Distance, geodesic_distance


@dataclass(frozen=True)
class Design:
    """A surface, the origins of distances, the starts of paths, and the camera."""

    surface: ck.ClosestPointSource
    origins: list
    starts: list
    spacing: float
    view: tuple[float, float, float]
    up: tuple[float, float, float]


def spot() -> Design:
    """From Spot's nose; paths from the tail and from a hind foot."""
    surface = ck.source("mesh.triangles", file="spot.obj", closest="smooth")
    starts = [[0.0, 0.2, 1.0], [-0.3, -0.72, 0.5], [-0.3, 0.1, 0.6]]
    return Design(surface, [[0.0, 0.25, -0.75]], starts, 0.06, (-1.0, 0.45, 0.25), (0.0, 1.0, 0.0))


def dziuk() -> Design:
    """From one point of Dziuk's surface, the zero set of a formula."""
    surface = ck.source("levelset.dziuk")
    starts = [[-0.9, -0.2, 0.2], [0.0, -1.0, -0.6], [-0.3, -0.6, 0.9]]
    return Design(surface, [[1.2, -0.1, 0.2]], starts, 0.1, (0.3, -1.0, 0.5), (0.0, 0.0, 1.0))


DESIGNS = {"spot": spot, "dziuk": dziuk}


def draw(design: Design, distance: Distance, file: str, lines: int = 20) -> None:
    """Draw the distance as colours, ``lines`` isolines at equal steps, the origins and the paths."""
    import pyvista

    vertices, faces = design.surface.mesh(0.3 * design.spacing)
    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    mesh["distance"] = distance.evaluate(vertices)
    size = float(np.ptp(design.surface.bounds, axis=0).max())
    plotter = pyvista.Plotter(off_screen=True, window_size=(1000, 800))
    plotter.add_mesh(mesh, scalars="distance", cmap="YlGnBu", smooth_shading=True, show_scalar_bar=False)
    steps = np.linspace(0, mesh["distance"].max(), lines + 1)[1:-1]
    plotter.add_mesh(mesh.contour(steps, "distance").tube(radius=0.0022 * size), color=(0.1, 0.1, 0.15))
    for path in distance.path(design.starts):
        plotter.add_mesh(pyvista.lines_from_points(path).tube(radius=0.008 * size), color=(0.85, 0.2, 0.1))
        plotter.add_mesh(pyvista.Sphere(radius=0.014 * size, center=path[0]), color=(0.85, 0.2, 0.1))
    for origin in distance.origins.points:
        plotter.add_mesh(pyvista.Sphere(radius=0.018 * size, center=origin), color=(0.95, 0.65, 0.1))
    plotter.background_color = "white"
    plotter.view_vector(design.view, viewup=design.up)
    plotter.camera.zoom(1.4)
    plotter.screenshot(file)


def main() -> None:
    """Measure and draw one of the designs."""
    if len(sys.argv) != 3 or sys.argv[1] not in DESIGNS:
        sys.exit(f"usage: python examples/distances.py {{{','.join(DESIGNS)}}} PICTURE.png")
    design = DESIGNS[sys.argv[1]]()
    distance = geodesic_distance(design.surface, design.origins, spacing=design.spacing)
    draw(design, distance, sys.argv[2])


if __name__ == "__main__":
    main()
