"""Lines over a drawing that follow from its mesh and values: outlines, edges, isolines, arrows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.view.colours import INK, Bar
from cpmkit.view.drawing import Drawing, in_space
from cpmkit.view.shapes import Shapes, lines

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord

#: Half the width of outlines, isolines, edges and the shafts of arrows, as shares of the picture's half width.
OUTLINE_WIDTH, ISOLINE_WIDTH, EDGE_WIDTH, SHAFT_WIDTH = 0.0016, 0.002, 0.0008, 0.0022
#: They lie so much before the surface, as a share of the picture's half width.
LIFT = 0.004
EDGE_COLOUR = (0.35, 0.35, 0.38)

#: Arrows stand on a grid of cells, so many on the picture's width; the longest are this share of a cell, the shortest
#: this share of those, and vectors below this share of the longest have none.
ARROW_CELLS, LONGEST_ARROW, SHORTEST_SHARE, LEAST_VECTOR = 26, 0.9, 0.45, 1e-6
#: A shaft follows the surface in so many steps; heads are this share of an arrow, and half as broad as this.
SHAFT_STEPS, HEAD_SHARE, HEAD_BREADTH = 6, 0.35, 0.4


def outlines(drawing: Drawing) -> Shapes:
    """Return the edges of the mesh between a triangle whose one side is seen and one whose other side is.

    Which side that is tells the winding; triangles that pass their edge the same way are wound against each other.
    """
    triangles, half = drawing.triangles[: drawing.mesh_triangles], drawing.camera.half[0]
    a, b, c = (drawing.points[triangles[:, k], :2] for k in range(3))
    front = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] > 0
    edges, members, counts = _edges(triangles)
    rising = np.concatenate([triangles[:, 0] < triangles[:, 1], triangles[:, 1] < triangles[:, 2],
                             triangles[:, 2] < triangles[:, 0]])  # fmt: skip
    alike = np.bincount(members, np.tile(front, 3) == rising, len(edges))  # 1 where the surface goes on
    turning = edges[(counts == 2) & (alike != 1)]
    return _lines(drawing, drawing.points, turning, OUTLINE_WIDTH * half, INK, lift=0.25 * LIFT)


def mesh_edges(drawing: Drawing) -> Shapes:
    """Return all edges of the mesh."""
    edges = _edges(drawing.triangles[: drawing.mesh_triangles])[0]
    return _lines(drawing, drawing.points, edges, EDGE_WIDTH * drawing.camera.half[0], EDGE_COLOUR)


def isolines(drawing: Drawing, values: Floats, levels: Sequence[float], bar: Bar) -> Shapes:
    """Return the lines on which ``values`` (v,) of the mesh's vertices, linear in each triangle, have given levels."""
    triangles = drawing.triangles[: drawing.mesh_triangles]
    found = [np.zeros((0, 2, 3))]
    for level in levels:
        above = values[triangles] > level
        crossed = triangles[above.any(axis=1) & ~above.all(axis=1)]
        up = values[crossed] > level
        lone = np.argmax(up == (up.sum(axis=1) == 1)[:, None], axis=1)  # the corner that is alone on its side
        rows = np.arange(len(crossed))
        tip, ends = crossed[rows, lone], [crossed[rows, (lone + k) % 3] for k in (1, 2)]
        shares = [(level - values[tip]) / (values[end] - values[tip]) for end in ends]
        points = drawing.points
        found.append(
            np.stack(
                [points[tip] + s[:, None] * (points[e] - points[tip]) for s, e in zip(shares, ends, strict=True)], 1
            )
        )
    segments, half = np.concatenate(found), drawing.camera.half[0]
    colours = np.repeat(bar.contrasting(np.array([0.0, *levels])), [len(part) for part in found], axis=0)
    return lines(segments[:, 0], segments[:, 1], ISOLINE_WIDTH * half, LIFT * half, colours)


def arrows(drawing: Drawing, solution: SolutionRecord, mesh: DisplayMesh, vectors: Floats, bar: Bar) -> Shapes:
    """Return arrows along ``vectors`` (v, d) at the mesh's vertices, bent so that they stay on the surface.

    Their lengths tell less than the colours of ``bar`` do: the shortest are a share of the longest, to be seen.
    """
    half = drawing.camera.half[0]
    cell = 2 * half / ARROW_CELLS
    sizes = np.linalg.norm(vectors, axis=1)
    seeds = _one_a_cell(mesh.points, cell)
    seeds = seeds[sizes[seeds] > LEAST_VECTOR * sizes.max(initial=0.0)]
    if not len(seeds):
        return Shapes.join([])
    shares = SHORTEST_SHARE + (1 - SHORTEST_SHARE) * sizes[seeds] / sizes.max()
    lengths = LONGEST_ARROW * cell * shares
    steps = np.linspace(-0.5, 0.5, SHAFT_STEPS + 1)[:, None]
    along = (lengths / sizes[seeds])[:, None] * vectors[seeds]
    path = mesh.points[seeds][:, None] + steps * along[:, None]
    on_surface = solution.scene.surface.closest_point(np.ascontiguousarray(path.reshape(-1, path.shape[2]))).points
    place = drawing.camera.project(in_space(on_surface)).reshape(len(seeds), -1, 3)
    colours = bar.contrasting(sizes[seeds])
    starts, ends = (part.reshape(-1, 3) for part in (place[:, :-1], place[:, 1:]))
    shafts = lines(starts, ends, SHAFT_WIDTH * half, LIFT * half, np.repeat(colours, SHAFT_STEPS, axis=0))
    return Shapes.join([shafts, _heads(place[:, -1], place[:, -2], HEAD_SHARE * lengths, colours, LIFT * half)])


def _heads(tips: Floats, before: Floats, lengths: Floats, colours: Floats, lift: float) -> Shapes:
    """Return triangles with their points a little beyond ``tips``, away from ``before``, as long as they appear."""
    ahead = tips - before
    whole = np.maximum(np.linalg.norm(ahead, axis=1), 1e-300)
    ahead *= (lengths / whole)[:, None]
    across = HEAD_BREADTH * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))])
    points = np.stack([tips + 0.4 * ahead, tips - 0.6 * ahead + across, tips - 0.6 * ahead - across], axis=1)
    cells = np.arange(3 * len(tips)).reshape(-1, 3)
    return Shapes(points.reshape(-1, 3) + [0, 0, lift], np.repeat(colours, 3, axis=0), cells)


def _one_a_cell(points: Floats, cell: float) -> Ints:
    """Return of the points in each cell of a cubic grid the one nearest to its middle."""
    scaled = points / cell
    cells = np.floor(scaled)
    order = np.argsort(np.linalg.norm(scaled - cells - 0.5, axis=1), kind="stable")
    return order[np.unique(cells[order], axis=0, return_index=True)[1]]


def _edges(triangles: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the edges (e, 2), which of them each side (3 t,) of a triangle is, and in how many each is."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, members, counts = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    return edges, members.ravel(), counts


def _lines(drawing: Drawing, points: Floats, edges: Ints, width: float, colour: object, lift: float = LIFT) -> Shapes:
    return lines(points[edges[:, 0]], points[edges[:, 1]], width, lift * drawing.camera.half[0], colour)
