"""Direction fields extended by parallel transport, on a mesh, a level set, a point cloud and a Moebius strip.

    python examples/vector_fields.py spot vectors-spot.png                  (needs spot.obj: docs/how-to/read-a-mesh.md)
    python examples/vector_fields.py double-torus vectors-double-torus.png
    python examples/vector_fields.py cloud vectors-cloud.png                (needs spot.obj)
    python examples/vector_fields.py moebius vectors-moebius.png

Directions are prescribed along the curves in the pictures. The command prints the singularities of the field and their
indices.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications import TangentField, vector_field

#: Spot's axes: z towards the tail, y up.
UP_OF_SPOT = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Design:
    """A surface, directions on it, the spacing to solve at, and where to look from."""

    surface: ck.ClosestPointSource
    directions: list[tuple[Any, Any]]
    spacing: float
    view: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def solve(self, spacing: float | None = None) -> TangentField:
        """Return the field, at another spacing if one is given."""
        return vector_field(self.surface, self.directions, spacing=spacing or self.spacing)


def at(surface: ck.ClosestPointSource, point: list[float], direction: list[float], radius: float) -> tuple[Any, Any]:
    """Return one direction at a point, prescribed along a small circle around it."""
    return circle_around(surface, point, radius), np.array(direction)


def circle_around(surface: ck.ClosestPointSource, at: list[float], radius: float) -> ck.ClosestPointSource:
    """Return the points of a surface whose straight distance from that nearest to ``at`` is ``radius``."""
    x, y, z = (float(one) for one in surface.closest_point([at]).points[0])
    return ck.source(
        "cut.function", surface=surface, phi=f"(x - ({x}))**2 + (y - ({y}))**2 + (z - ({z}))**2 - {radius}**2"
    )


def spot() -> Design:
    """Spot, a mesh: round the belly one way before a ring and the other way behind it, up the face, down the legs."""
    cow = ck.source("mesh.triangles", file="spot.obj", closest="smooth")
    turn = -2 * np.pi * np.arange(20) / 20
    ring = np.stack([0.4 * np.cos(turn), -0.1 + 0.4 * np.sin(turn), np.full(20, 0.35)], axis=1)
    belly = ck.source("mesh.path", surface=cow, through=cow.closest_point(ring).points, closed=True)
    directions = [
        (belly, {"left": "tangent", "right": "backwards"}),
        at(cow, [0.0, 0.3, -0.75], [0.0, 1.0, 0.0], 0.1),
        at(cow, [-0.35, -0.55, -0.1], [0.0, -1.0, 0.0], 0.08),
    ]
    return Design(cow, directions, 0.05, (-1.0, 0.35, -0.6), UP_OF_SPOT)


def double_torus() -> Design:
    """A surface with two handles, the zero set of a formula: a vortex beside one, one direction at the other's end."""
    surface = ck.source(
        "levelset.expression",
        phi="(x*(x-1)**2*(x-2)+y**2)**2+z**2-0.03",
        bounds=[[-0.4, -0.9, -0.4], [2.4, 0.9, 0.4]],
    )
    directions = [
        (circle_around(surface, [1.0, 0.0, 0.5], 0.15), "tangent"),
        at(surface, [-0.2, 0, 0.2], [0.0, 1.0, 0.0], 0.1),
    ]
    return Design(surface, directions, 0.06, (0.4, -0.8, 1.2))


def cloud() -> Design:
    """Spot as a point cloud: the vertices of the mesh without its triangles."""
    cow = ck.source("pointcloud.points", points=ck.read_mesh("spot.obj")[0])
    directions = [
        at(cow, [0.0, 0.3, -0.75], [0.0, 1.0, 0.0], 0.1),
        (circle_around(cow, [-0.5, 0.0, 0.3], 0.12), "tangent"),
        at(cow, [-0.35, -0.55, -0.1], [0.0, -1.0, 0.0], 0.08),
    ]
    return Design(cow, directions, 0.05, (-1.0, 0.35, -0.6), UP_OF_SPOT)


def moebius() -> Design:
    """A Moebius strip, which has one side: a vortex and two directions that no choice of sides makes agree."""
    strip = ck.source("parametric.moebius")
    directions = [
        (circle_around(strip, [0.0, -1.0, 0.0], 0.15), "tangent"),
        at(strip, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.1),
        at(strip, [-1.0, 0.2, 0.1], [0.0, 0.0, 1.0], 0.1),
    ]
    return Design(strip, directions, 0.05, (0.5, -1.0, 0.9))


DESIGNS = {"spot": spot, "double-torus": double_torus, "cloud": cloud, "moebius": moebius}


def main() -> None:
    """Solve and draw one of the designs, and list its singularities."""
    if len(sys.argv) != 3 or sys.argv[1] not in DESIGNS:
        sys.exit(f"usage: python examples/vector_fields.py {{{','.join(DESIGNS)}}} PICTURE.png")
    design = DESIGNS[sys.argv[1]]()
    field = design.solve()
    for sentence in field.solution.warnings:
        print("warning:", sentence)
    if sys.argv[1] != "cloud":  # which has no triangles, on which alone they are found
        for one in field.singularities:
            print("index", f"{one.index:+d}", "at", one.place.round(2))
        print("sum of the indices:", sum(one.index for one in field.singularities))
    field.picture(sys.argv[2], view=design.view, up=design.up, width=680)


if __name__ == "__main__":
    main()
