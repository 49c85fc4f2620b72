"""Contents of a picture as plain arrays in the axes of its camera: the mesh, boundaries and lines in front of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.vector_algebra import in_three_dimensions, unit
from cpmkit.mesh.mesh import Connectivity
from cpmkit.scenefile.look import Look
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Ints
from cpmkit.view.colours import INK, Bar

#: Number of corners of a disc around a point of a cloud.
DISC_CORNERS = 8
#: Radii of boundary points, and of a curve that is itself the surface, as shares of the picture's half width.
PIN_RADIUS, STROKE_RADIUS = 0.012, 0.009
#: Distance of lines in front of the surface, as a share of the picture's half width.
LIFT = 0.004


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection."""

    centre: Floats  #: (3,): the point in the middle of the picture.
    axes: Floats  #: (3, 3): orthonormal rows: to the right, up, and towards the viewer.
    half: Floats  #: (2,): half the width and half the height that the picture shows, in the scene's unit of length.
    pixels: Ints  #: (2,) int: width and height of the picture.
    description: str = ""  #: The direction of the view and the vertical axis, in words.

    def project(self, points: Floats) -> Floats:
        """Return coordinates (n, 3) of points (n, 3): to the right of the centre, above it, and in front of it."""
        return np.asarray((points - self.centre) @ self.axes.T)


def make_camera(points: Floats, more: Floats, width: int, look: Look) -> Camera:
    """Return the camera that shows the model ``points`` (n, d) and ``more`` (k, 3) as large as ``width`` pixels allow.

    A model in the plane is seen from above, a model in space from ``look.view`` with ``look.up`` upwards. By default y
    is up if the model stands stably on its lowest y, and less stably on its lowest z; else z is up. If the view is
    along that axis, the other of the two is up. The picture is 0.4 to 1.4 times as high as wide, as the model requires.
    Raises InputError if ``view`` and ``up`` of the look, in space, are parallel, or either is zero.
    """
    if points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
        axes, description = camera_axes((0.0, 0.0, 1.0), "y"), "the plane from above"
    else:
        up, guessed = look.up, ""
        if up is None:  # y if the model stands on its lowest y and less stably on its lowest z, else z
            y, z = (stability(points, axis) for axis in (1, 2))
            up = "y" if y > 0.08 and y > 2 * z else "z"
            if (
                look.view is not None and abs(_camera_direction(look.view, "view")["xyz".index(up)]) > 0.999
            ):  # from above or below
                up = "z" if up == "y" else "y"
            guessed = ", on which the model stands" if up == "y" else ""
        axes = camera_axes(look.view, up)
        description = f"seen from {_as_text(axes[2])}, {up if isinstance(up, str) else _as_text(up)} up{guessed}"
    projected = np.concatenate([points, more]) @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    extent = (high - low) / 2
    margin = 0.04 * (extent.max() or 1.0)
    half_width = max(extent[0] + margin, (extent[1] + margin) / 1.4)  # the height is 0.4 to 1.4 times the width
    half_height = max(extent[1] + margin, 0.4 * half_width)
    pixels = np.array([width, round(width * half_height / half_width)])
    return Camera((low + high) / 2 @ axes, axes, np.array([half_width, half_height]), pixels, description)


def stability(points: Floats, axis: int) -> float:
    """Return how stably a model ``points`` (n, 3) stands with ``axis`` up: zero or negative if it would fall over.

    The result is the distance of the points' mean, seen from above, from the rim of the base, over the diagonal of the
    points' horizontal bounds. The base is the convex hull of the points in the lowest 3 percent of the height; if it
    has no area, the result is zero. ``axis`` is 0, 1 or 2.
    """
    from scipy.spatial import ConvexHull, QhullError

    height = points[:, axis]
    flat = np.delete(points, axis, axis=1)
    ground = flat[height <= height.min() + 0.03 * np.ptp(height)]
    breadth = float(np.linalg.norm(np.ptp(flat, axis=0)))
    if len(ground) < 3 or breadth == 0:
        return 0.0
    try:
        sides = ConvexHull(ground).equations
    except QhullError:  # the ground is a point or a line
        return 0.0
    return float(-(sides[:, :2] @ flat.mean(axis=0) + sides[:, 2]).max() / breadth)


def camera_axes(view: Any, up: Any) -> Floats:
    """Return the axes (3, 3) of a camera: rows to the right, up, and towards the viewer.

    ``view`` (3,) points from the model to the camera. By default the camera is in front of the model, to the right and
    above: the front is +z if y is up, else -y for z and -z for x. ``up`` is "x", "y", "z" or (3,), by default z. Raises
    InputError if a vector is zero, or the two are parallel.
    """
    upward = _camera_direction(np.eye(3)["xyz".index(up)] if isinstance(up, str) else up or (0.0, 0.0, 1.0), "up")
    axis = int(np.abs(upward).argmax()) if np.abs(upward).max() > 0.999 else 2  # oblique: the front of z up
    default = ((0.6, 0.55, -1.0), (0.55, 0.6, 1.0), (0.55, -1.0, 0.6))[axis]
    toward = _camera_direction(default if view is None else view, "view")
    right = np.cross(upward, toward)
    if np.linalg.norm(right) < 1e-6:
        raise InputError(f"view and up must not be parallel, got {toward.tolist()} and {upward.tolist()}.")
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _as_text(vector: Sequence[float] | Floats) -> str:
    """Return a vector as the text "(x, y, z)", with two digits."""
    return "(" + ", ".join(f"{entry:.2g}" for entry in vector) + ")"


def _camera_direction(direction: Any, label: str) -> Floats:
    """Return the unit vector (3,) of a camera's direction; raise InputError, with ``label``, if it is zero."""
    vector = np.array(direction, dtype=np.float64)
    if not vector.any():
        raise InputError(f"{label} must be a direction, got three zeros.")
    scaled = vector / np.abs(vector).max()
    return np.asarray(scaled / np.linalg.norm(scaled))


@dataclass(frozen=True, eq=False)
class Shapes:
    """Triangles with a colour at each vertex, interpolated between."""

    #: points, colours (v, 3): vertices in the camera's axes, and their colours from 0 to 1.
    points: Floats
    colours: Floats
    triangles: Ints  #: (t, 3): the vertices of each triangle.

    @classmethod
    def join(cls, parts: list[Shapes]) -> Shapes:
        """Return all vertices and triangles of ``parts``, in their order, as one object; it is empty for no parts."""
        parts = [cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)), *parts]
        starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.colours for part in parts]),
            np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
        )


def line_shapes(camera: Camera, segments: Floats, width: float, colour: Any, lift: float = LIFT) -> Shapes:
    """Return ``segments`` (s, 2, 3), in the camera's axes, as rectangles of ``colour``, (3,) or (s, 3).

    ``width``, half that of a line, and ``lift``, the shift towards the viewer, are shares of the picture's half width.
    """
    points, triangles = ribbons(segments[:, 0], segments[:, 1], width * camera.half[0])
    colours = np.broadcast_to(np.asarray(colour, dtype=np.float64), (len(segments), 3))
    return Shapes(points + [0, 0, lift * camera.half[0]], np.repeat(colours, 4, axis=0), triangles)


def ribbons(starts: Floats, ends: Floats, half_width: float) -> tuple[Floats, Ints]:
    """Return vertices (4 s, 3) and triangles (2 s, 3) of rectangles along segments, which face the viewer.

    ``starts`` and ``ends`` are (s, 3) in the camera's axes. A rectangle is longer by ``half_width`` than its segment,
    and has no area if the segment points at the viewer; its first two vertices are at the start, the others at the end.
    """
    along = (ends - starts)[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = half_width * np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    flat = np.zeros(len(along))
    across, beyond = np.column_stack([-along[:, 1], along[:, 0], flat]), 0.5 * np.column_stack([along, flat])
    corners = (starts - beyond - across, starts - beyond + across, ends + beyond + across, ends + beyond - across)
    points = np.stack(corners, axis=1)
    fan = 4 * np.arange(len(starts))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return points.reshape(-1, 3), fan.reshape(-1, 3)


def discs(centres: Floats, normals: Floats, radii: Floats, corners: int = DISC_CORNERS) -> tuple[Floats, Ints]:
    """Return vertices (corners p, 3) and triangles ((corners - 2) p, 3) of discs about ``centres`` (p, 3).

    ``radii`` are (p,); all are in the camera's axes. Discs are normal to ``normals`` (p, 3), of unit length and any
    sign; with a normal of zero they face the viewer.
    """
    normals = np.where(normals.any(axis=1, keepdims=True), normals, np.array([0, 0, 1.0]))
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = 2 * np.pi * np.arange(corners) / corners
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    corner = np.arange(1, corners - 1)
    fan = np.stack([np.zeros_like(corner), corner, corner + 1], axis=1)
    triangles = corners * np.arange(len(centres))[:, None, None] + fan
    return (centres[:, None] + radii[:, None, None] * around).reshape(-1, 3), triangles.reshape(-1, 3)


def disc_radii(points: Floats, spacing: float, least: float, alone: float) -> Floats:
    """Return radii (p,) with which discs around points (p, d) cover a surface, or a curve in the plane, without holes.

    A radius is a share of the distance to the sixth neighbour (in the plane to the second), limited to twice the median
    of these distances; it is at least ``least``. Points farther than ten spacings from that neighbour, or without one,
    have the radius ``alone``.
    """
    from scipy.spatial import cKDTree

    neighbours, share = (2, 0.5) if points.shape[1] == 2 else (6, 0.85)
    if len(points) <= neighbours:
        return np.full(len(points), alone)
    reach = np.asarray(cKDTree(points).query(points, k=neighbours + 1)[0])[:, -1]
    lonely = reach > 10 * spacing
    usual = np.median(reach[~lonely]) if not lonely.all() else 0.0
    return np.where(lonely, alone, np.maximum(share * np.minimum(reach, 2 * usual), least))


@dataclass(frozen=True, eq=False)
class Drawing:
    """The cells of a mesh without values, which pictures may share, the boundaries over them, and the camera."""

    camera: Camera
    #: (v, 3): vertices of ``triangles`` (t, 3), in the camera's axes: the mesh's own first, then those of strokes and
    #: discs, which stand for segments and points.
    points: Floats
    owner: Ints  #: (v,): the vertex of the mesh whose value each vertex shows.
    #: (v, 3): unit normals in the camera's axes, zero on strokes; no rows in the plane and for segments alone.
    normals: Floats
    triangles: Ints
    mesh_triangles: int  #: Number of triangles of the mesh itself, which come first.
    lit: bool  #: Whether the triangles are shaded.
    ink: Shapes  #: The boundaries and, if requested, ties and points at doubled nodes.


def draw_mesh(solution: SolutionRecord, mesh: DisplayMesh, look: Look, width: int, lit: bool) -> Drawing:
    """Return a drawing, ``width`` pixels wide, without edges of triangles; shaded if ``lit`` and there are normals."""
    camera, curves, pins = fit_camera(solution, mesh, look, width)
    half = camera.half[0]
    normals = np.zeros((0, 3)) if mesh.normals is None else mesh.normals @ camera.axes.T
    place = camera.project(in_three_dimensions(mesh.points))
    facing = normals[mesh.dots] if len(normals) else np.zeros((len(mesh.dots), 3))
    radii = disc_radii(mesh.points[mesh.dots], solution.spacing, STROKE_RADIUS * half, PIN_RADIUS * half)
    rims, fans = discs(place[mesh.dots], facing, radii)
    strokes, stroke_cells = ribbons(place[mesh.segments[:, 0]], place[mesh.segments[:, 1]], STROKE_RADIUS * half)
    rounds, cells = discs(camera.project(pins), np.zeros_like(pins), np.full(len(pins), PIN_RADIUS * half), 24)
    dots = Shapes(rounds + [0, 0, PIN_RADIUS * half], np.tile(INK, (len(rounds), 1)), cells)
    # Curves are lifted, since the surface is flat between its vertices.
    ink = [line_shapes(camera, camera.project(curves), 0.0045, INK, lift=0.009), dots]
    added, ends = (np.repeat(facing, DISC_CORNERS, axis=0), np.zeros_like(strokes)), np.repeat(mesh.segments.ravel(), 2)
    return Drawing(
        camera=camera,
        points=np.concatenate([place, rims, strokes]),
        owner=np.concatenate([np.arange(len(place)), np.repeat(mesh.dots, DISC_CORNERS), ends]),
        normals=np.concatenate([normals, *added]) if len(normals) else normals,
        triangles=np.concatenate([mesh.triangles, len(place) + fans, len(place) + len(rims) + stroke_cells]),
        mesh_triangles=len(mesh.triangles),
        lit=lit and len(normals) > 0,
        ink=Shapes.join(ink),
    )


def fit_camera(solution: SolutionRecord, mesh: DisplayMesh, look: Look, width: int) -> tuple[Camera, Floats, Floats]:
    """Return the camera, and what ``look`` shows of boundaries, ties and twins: segments (s, 2, 3), points (k, 3)."""
    curves, pins = [np.zeros((0, 2, 3))], [np.zeros((0, 3))]
    for boundary in solution.scene.boundaries if look.curves else ():
        if isinstance(boundary.source, HasMesh):
            vertices, cells = boundary.source.mesh(solution.spacing)
            if cells.shape[1] == 2:
                curves.append(in_three_dimensions(vertices)[cells])
            elif cells.shape[1] == 1:
                pins.append(in_three_dimensions(vertices))
    if look.twins:
        pins.append(in_three_dimensions(solution.doubled))
    if look.ties:
        ends = solution.ties
        places = in_three_dimensions(ends.reshape(-1, ends.shape[2]))
        if ends.shape[1] == 2:
            curves.append(places.reshape(-1, 2, 3))
        else:
            pins.append(places)
    segments, dots = np.concatenate(curves), np.concatenate(pins)
    more = np.concatenate([segments.reshape(-1, 3), dots])
    return make_camera(mesh.points, more, width, look), segments, dots


def outlines(drawing: Drawing) -> Shapes:
    """Return the silhouette: lines on edges of two triangles, of which one shows its front and the other its back.

    Front and back follow from the order of corners, for which two triangles that list their common edge in the same
    direction have opposite orientations.
    """
    triangles = drawing.triangles[: drawing.mesh_triangles]
    a, b, c = (drawing.points[triangles[:, k], :2] for k in range(3))
    front = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] > 0
    edges = Connectivity(triangles, len(drawing.points)).edges
    sides = edges.of_cells.ravel()
    rising = np.roll(triangles, -1, axis=1) < np.roll(triangles, -2, axis=1)  # of the side opposite to each corner
    alike = np.bincount(sides, (front[:, None] == rising).ravel(), len(edges.ends))  # 1: both show the same side
    turning = (np.bincount(sides, minlength=len(edges.ends)) == 2) & (alike != 1)
    return line_shapes(drawing.camera, drawing.points[edges.ends[turning]], 0.0016, INK, lift=0.25 * LIFT)


def mesh_edges(drawing: Drawing) -> Shapes:
    """Return all edges of the drawing's mesh triangles as grey lines, in the camera's axes."""
    edges = Connectivity(drawing.triangles[: drawing.mesh_triangles], len(drawing.points)).edges.ends
    return line_shapes(drawing.camera, drawing.points[edges], 0.0008, (0.35, 0.35, 0.38))


def isolines(drawing: Drawing, values: Floats, levels: Sequence[float], bar: Bar) -> Shapes:
    """Return lines where ``values`` (v,), linear in triangles, equal ``levels``, in contrast to colours of ``bar``."""
    triangles, points = drawing.triangles[: drawing.mesh_triangles], drawing.points
    segments_of_level = [np.zeros((0, 2, 3))]
    for level in levels:
        above = values[triangles] > level
        crossed = triangles[above.any(axis=1) & ~above.all(axis=1)]
        up = values[crossed] > level
        lone = np.argmax(up == (up.sum(axis=1) == 1)[:, None], axis=1)  # the only corner on its side of the level
        rows = np.arange(len(crossed))
        tip, ends = crossed[rows, lone], [crossed[rows, (lone + k) % 3] for k in (1, 2)]
        shares = [(level - values[tip]) / (values[end] - values[tip]) for end in ends]
        crossings = [points[tip] + s[:, None] * (points[e] - points[tip]) for s, e in zip(shares, ends, strict=True)]
        segments_of_level.append(np.stack(crossings, axis=1))
    colours = np.repeat(bar.ink_colours(np.array([0.0, *levels])), [len(part) for part in segments_of_level], axis=0)
    return line_shapes(drawing.camera, np.concatenate(segments_of_level), 0.002, colours)


def arrows(drawing: Drawing, mesh: DisplayMesh, vectors: Floats, bar: Bar) -> Shapes:
    """Return arrows along ``vectors`` (v, d), centred at vertices of the mesh, in a grid that is 26 cells wide.

    Each cell has at most one arrow. Short vectors have arrows of a least length, vectors below a millionth of the
    longest have none. Arrows contrast with the colours of ``bar``, which show the lengths.
    """
    cell, sizes = 2 * drawing.camera.half[0] / 26, np.linalg.norm(vectors, axis=1)
    cells, within = np.divmod(mesh.points / cell, 1)
    order = np.argsort(np.linalg.norm(within - 0.5, axis=1), kind="stable")
    seeds = order[np.unique(cells[order], axis=0, return_index=True)[1]]  # the nearest to the centre of its cell
    seeds = seeds[sizes[seeds] > 1e-6 * sizes.max(initial=0.0)]
    if not len(seeds):
        return Shapes.join([])
    lengths = 0.9 * cell * (0.45 + 0.55 * sizes[seeds] / sizes.max())
    along = 0.5 * (lengths / sizes[seeds])[:, None] * vectors[seeds]
    starts, ends = (drawing.camera.project(in_three_dimensions(mesh.points[seeds] + sign * along)) for sign in (-1, 1))
    colours = bar.ink_colours(sizes[seeds])
    shafts = line_shapes(drawing.camera, np.stack([starts, ends], axis=1), 0.0022, colours)
    ahead = 0.35 * lengths[:, None] * unit(ends - starts)
    across = 0.4 * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))])
    heads = np.stack([ends + 0.4 * ahead, ends - 0.6 * ahead + across, ends - 0.6 * ahead - across], axis=1)
    corners = heads.reshape(-1, 3) + [0, 0, LIFT * drawing.camera.half[0]]
    cells = np.arange(len(corners)).reshape(-1, 3)
    return Shapes.join([shafts, Shapes(corners, np.repeat(colours, 3, axis=0), cells)])
