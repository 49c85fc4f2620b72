"""Boundaries into sample meshes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.mixed_cells import Polyline
from cpmkit.meshing.insertion.alongside import Chain, side_by_side
from cpmkit.meshing.insertion.coincidence import on_earlier, runs_close
from cpmkit.meshing.insertion.curves import Course, chain_of, course, insert_curve
from cpmkit.meshing.insertion.feet import Triangles
from cpmkit.meshing.insertion.lined_mesh import AT_MOVABLE_SHARE, AT_SHARE, LinedMesh
from cpmkit.meshing.insertion.points import cut_at_points, positions
from cpmkit.meshing.insertion.polylines import drawn, in_space
from cpmkit.meshing.insertion.tips import extend, mend
from cpmkit.meshing.insertion.tracing import traced
from cpmkit.meshing.insertion.triangulation import Triangulation
from cpmkit.meshing.insertion.walk import Walker
from cpmkit.protocols import Floats, Ints

#: Curves are extended past their tips by so many spacings.
EXTENSION_SPACINGS = 3.0


@dataclass(frozen=True, eq=False)
class Insertion:
    """A mesh with boundaries in it, and what is to be told of how they came there.

    Attributes
    ----------
    mesh : SampleMesh
        Flat, with ``cut``, ``owner`` and ``extends``.
    point_vertices : dict
        The vertices (k,) of each boundary of points on a surface, which cuts nothing.
    empty : tuple of int
        Boundaries that left neither edge nor vertex.
    coincident : frozenset of (int, int)
        A boundary and an earlier one that it lies on in places; the edges there are the earlier one's.
    max_distances : dict of float
        How far each boundary lies off the mesh at most, but for what passes its rim.
    counts : dict
        ``erased`` short loops, ``disconnected`` curves whose feet do not hang together, ``pruned`` tails, ``joined``
        tips, ``tips`` that are left and extended.
    """

    mesh: Mesh
    point_vertices: dict[int, Ints] = field(default_factory=dict)
    empty: tuple[int, ...] = ()
    coincident: frozenset[tuple[int, int]] = frozenset()
    counts: dict[str, int] = field(default_factory=dict)
    max_distances: dict[int, float] = field(default_factory=dict)


def insert_boundaries(
    mesh: Mesh, boundaries: Sequence[LocalSource], spacing: float, movable: bool = False
) -> Insertion:
    """Return the mesh with its boundaries made facets: curves edges of triangles, points vertices.

    Vertices that are added lie on the flat cells given.

    Parameters
    ----------
    mesh : SampleMesh
        Sound, flat, not cut. Its facets may have any number of cells.
    boundaries : sequence of LocalSource
        Relative to the same origin; curves and points on a surface, points on a curve.
    spacing : float
        h, of the lattice.
    movable : bool
        Whether vertices are moved later, those of curves onto these: lines may then go through vertices beside them.
    """
    if not boundaries:
        return Insertion(mesh)
    if mesh.manifold_dim == 1:
        cut, empty, gaps = cut_at_points(mesh, boundaries)
        return Insertion(cut, empty=empty, max_distances=gaps)
    walker, told = _walker(mesh, spacing, movable), Counter[str]()
    courses = _courses(walker, boundaries, spacing)
    walker.lined.close = frozenset(n for n, lines in enumerate(courses) if _runs_close(lines, boundaries, n, spacing))
    points, gaps = dict[int, Ints](), dict.fromkeys(range(len(boundaries)), 0.0)
    for number, boundary in enumerate(boundaries):
        walker.lined.owner = number
        at = [positions(member, mesh.vertices) for member in boundary.members if member.manifold_dim == 0]
        if at:
            points[number], gaps[number] = _vertices(walker, np.concatenate(at))
        for one in courses[number]:
            gaps[number] = max(gaps[number], insert_curve(walker, one, told))
    mend(walker, told)
    extend(walker, EXTENSION_SPACINGS * spacing, told)
    cut = _with_lines(walker, mesh.dim)
    empty = tuple(n for n in range(len(boundaries)) if n not in points and n not in cut.owner)
    return Insertion(cut, points, empty, _shared(courses), dict(told), gaps)


def _walker(mesh: Mesh, spacing: float, movable: bool) -> Walker:
    net = Triangulation(in_space(mesh.vertices), mesh.cells, spacing)
    lined = LinedMesh(net, AT_MOVABLE_SHARE if movable else AT_SHARE)
    return Walker(lined, Triangles(net.vertices, net.cells, net.sizes))


def _courses(walker: Walker, boundaries: Sequence[LocalSource], spacing: float) -> list[list[Course]]:
    """Return the curves of each boundary."""

    def on(chain: Chain) -> Ints:
        points = chain.loop[:, : chain.curve.dim]
        return on_earlier(points, chain.curve, boundaries[: chain.owner], spacing)

    chains = [chain for number in range(len(boundaries)) for chain in _chains(walker, boundaries, number, spacing)]
    places = [on(chain) for chain in chains]
    shared = {(k, other) for k, place in enumerate(places) for other in np.unique(place[place >= 0]).tolist()}
    courses: list[Course] = []
    found: list[list[Course]] = [[] for _ in boundaries]
    for before, chain, place in zip(chains, side_by_side(chains, spacing, shared), places, strict=True):
        courses.append(course(walker.triangles, chain, place if chain is before else on(chain), courses))
        found[chain.owner].append(courses[-1])
    return found


def _chains(walker: Walker, boundaries: Sequence[LocalSource], number: int, spacing: float) -> Iterator[Chain]:
    for curve in boundaries[number].members:
        if curve.manifold_dim == 1:
            lines = drawn(curve, 0.5 * spacing)
            for line in traced(curve, walker.triangles, spacing) if lines is None else lines:
                yield chain_of(walker.triangles, Polyline(in_space(line.points), line.closed), curve, number)


def _runs_close(lines: Sequence[Course], boundaries: Sequence[LocalSource], own: int, spacing: float) -> bool:
    others = [*boundaries[:own], *boundaries[own + 1 :]]
    return any(runs_close(line.points[:, : boundaries[own].dim], others, spacing) for line in lines)


def _shared(courses: Sequence[Sequence[Course]]) -> frozenset[tuple[int, int]]:
    """Return the pairs of a boundary and an earlier one on which some neighbouring points of it lie."""
    found = set()
    for number, lines in enumerate(courses):
        for line in lines:
            stretches = line.on[1:][(line.on[1:] == line.on[:-1]) & (line.on[1:] >= 0)]
            found |= {(number, other) for other in stretches.tolist()}
    return frozenset(found)


def _vertices(walker: Walker, points: Floats) -> tuple[Ints, float]:
    """Return the vertices (k,) at the feet of ``points`` (k, d), and how far off these lie at most."""
    feet = walker.triangles.nearest(in_space(points))
    places = np.einsum("nk,nkd->nd", feet.shares, walker.net.vertices[walker.net.cells[feet.cell]])
    pairs = zip(feet.cell.tolist(), places.tolist(), strict=True)
    found = np.array([walker.lined.inserted(cell, (x, y, z)) for cell, (x, y, z) in pairs], dtype=np.int64)
    return found, float(feet.distance.max())


def _with_lines(walker: Walker, dim: int) -> Mesh:
    lines = list(walker.lined.cut.values())
    return replace(
        walker.net.mesh(dim),
        cut=np.array([(line.tail, line.head) for line in lines], dtype=np.int64).reshape(-1, 2),
        owner=np.array([line.owner for line in lines], dtype=np.int64),
        beyond_tip=np.array([line.beyond_tip for line in lines], dtype=bool),
    )
