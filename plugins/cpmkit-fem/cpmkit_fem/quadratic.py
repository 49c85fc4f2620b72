"""Cells with midpoints, of degree 2, and where they lie: on the surface, its rim, and boundaries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.plugin import Bools, CutMesh, Floats, Ints, Scene
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.elements import EDGES_OF, NODES, shape_at
from cpmkit_fem.location import nearest_on_cells
from cpmkit_fem.rim import outside, rim_facets
from cpmkit_fem.surface_mapping import jacobians, unfold

#: A node stays on its flat cell where it would be moved by more than this share of an edge.
MOVED_EDGE_SHARE = 0.25
#: Cells keep at least this share of their flat measure everywhere, or their nodes stay where they were.
LEAST_MEASURE_SHARE = 0.2
#: How often cells are looked at again after nodes of others stayed, at first midpoints alone: in the end all are flat.
ROUNDS_OF_STAYING, ROUNDS_OF_STRAIGHTENING = 20, 4
#: Rounds in which a node comes onto two boundaries, or a boundary and the rim; each asks nearer to the rim by a factor.
ROUNDS_OF_MEETING, NEARER = 5, 0.125


def with_midpoints(mesh: CellMesh) -> CellMesh:
    """Return cells of degree 1 as such of degree 2, with straight edges."""
    k = mesh.manifold_dim + 1
    pairs = np.sort(mesh.corners[:, EDGES_OF[mesh.manifold_dim]].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middles = len(mesh.nodes) + number.reshape(len(mesh.cells), -1)
    cells = np.hstack([mesh.corners, middles])
    assert cells.shape[1] == NODES[mesh.manifold_dim, 2]
    assert mesh.corners.shape[1] == k
    return CellMesh(np.concatenate([mesh.nodes, mesh.nodes[edges].mean(axis=1)]), cells, mesh.manifold_dim, 2)


def curved(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> tuple[CellMesh, Floats]:
    """Return a mesh whose nodes are moved onto the surface, on its rim and on boundaries onto these.

    Nodes beside these are moved along, so that thin cells keep their shape. Nodes stay where the way is far, or would
    fold a cell; how far they are (n,) from where they belong is returned too.
    """
    lines, wanted = _on_lines(scene, mesh, cut)
    joined, number = _joined(mesh)
    reach = _edge_at_nodes(joined)[number]
    others = np.setdiff1d(np.arange(len(mesh.nodes)), lines)
    if mesh.manifold_dim == 2 and len(lines):
        wanted[others] += _carried(mesh, lines, wanted - mesh.nodes, mesh.nodes[others], reach)
    wanted[others] = scene.surface.closest_point(wanted[others]).points
    far = np.linalg.norm(wanted - mesh.nodes, axis=1) > MOVED_EDGE_SHARE * reach
    kept = wanted.copy()
    kept[far] = mesh.nodes[far]
    places = joined.nodes.copy()
    places[number] = kept
    nodes = _unfolded(joined, places)[number]
    return replace(mesh, nodes=nodes, curved=True), np.linalg.norm(nodes - wanted, axis=1)


def _on_lines(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> tuple[Ints, Floats]:
    """Return the facets (f, c) on boundaries and the rim, and where nodes (n, d) on these belong, others unmoved."""
    wanted, none = mesh.nodes.copy(), np.zeros((0, mesh.manifold_dim), dtype=np.int64)
    rim, opposite = rim_facets(mesh, none if cut is None else cut.edges)
    if len(rim) and mesh.manifold_dim == 2:
        wanted[rim[:, 2]] = scene.surface.closest_point(outside(mesh.nodes, rim, opposite)).points
    if cut is None:
        return rim, wanted
    own = [np.unique(mesh.with_midpoints(cut.edges[cut.owner == number])) for number in range(len(scene.boundaries))]
    own = [np.union1d(nodes, cut.points.get(number, nodes)) for number, nodes in enumerate(own)]
    on, count = np.unique(np.concatenate(own), return_counts=True)
    ends = np.intersect1d(on, rim[:, : mesh.manifold_dim])
    outward = np.zeros_like(wanted)
    outward[rim[:, : mesh.manifold_dim]] = (
        outside(mesh.nodes, rim, opposite) - mesh.nodes[rim[:, : mesh.manifold_dim]].mean(axis=1)
    )[:, None]
    meeting = np.union1d(on[count > 1], ends)
    for turn in range(ROUNDS_OF_MEETING):
        for boundary, nodes in zip(scene.boundaries, own, strict=True):
            at = nodes if turn == 0 else np.intersect1d(nodes, meeting)
            if len(at):
                wanted[at] = scene.surface.closest_point(boundary.source.closest_point(wanted[at]).points).points
        if len(ends):
            wanted[ends] = scene.surface.closest_point(wanted[ends] + NEARER**turn * outward[ends]).points
    return np.concatenate([rim, mesh.with_midpoints(cut.edges)]), wanted


def _carried(mesh: CellMesh, lines: Ints, moved: Floats, points: Floats, reach: Floats) -> Floats:
    """Return how far ``points`` (k, d) are carried along with the line next to them, whose nodes are ``moved`` (n, d).

    As the place next to them is, less by how far they are from it; not at all from the ``reach`` (n,) of its nodes on.
    """
    line, local = nearest_on_cells(mesh.nodes, lines[:, :2], points)
    ends = lines[line]
    feet = np.einsum("kc,kcd->kd", local, mesh.nodes[ends[:, :2]])
    share = 1 - np.linalg.norm(points - feet, axis=1) / reach[ends].max(axis=1)
    at_feet = np.einsum("ck,kcd->kd", shape_at(1, 2, local[:, 1:].T).values, moved[ends])
    return np.asarray(np.maximum(share, 0.0)[:, None] * at_feet)


def _joined(mesh: CellMesh) -> tuple[CellMesh, Ints]:
    """Return the mesh with one node where a cut has two, and the number (n,) there of each node."""
    nodes, number = np.unique(mesh.nodes, axis=0, return_inverse=True)
    number = number.ravel()
    return replace(mesh, nodes=nodes, cells=number[mesh.cells]), number


def _edge_at_nodes(mesh: CellMesh) -> Floats:
    """Return the length (n,) of the shortest cell's longest edge at each node."""
    found = np.full(len(mesh.nodes), np.inf)
    np.minimum.at(found, mesh.cells, mesh.longest_edges[:, None])
    return found


def _unfolded(mesh: CellMesh, wanted: Floats) -> Floats:
    """Return the nodes where they are ``wanted`` (n, d), but for those of cells that would fold."""
    nodes, k = wanted.copy(), mesh.manifold_dim + 1
    for turn in range(ROUNDS_OF_STAYING):
        folded = mesh.cells[_folded(mesh, nodes)]
        if not len(folded):
            return nodes
        if turn >= ROUNDS_OF_STRAIGHTENING:
            nodes[folded] = mesh.nodes[folded]
        nodes[folded[:, k:]] = nodes[folded[:, EDGES_OF[mesh.manifold_dim]]].mean(axis=2)
    return mesh.nodes


def _folded(mesh: CellMesh, nodes: Floats) -> Bools:
    """Return which cells (m,) shrink too far, or turn over, somewhere, seen from the flat ones."""
    dim = mesh.manifold_dim
    corners = np.array([[0, 1, 0, 0.5, 0.5, 0], [0, 0, 1, 0, 0.5, 0.5]]) if dim == 2 else np.array([[0, 1, 0.5]])
    flat = shape_at(dim, 1, corners[:, :1])
    inverse = unfold(jacobians(mesh.nodes, mesh.corners, flat))[1]
    now = jacobians(nodes, mesh.cells, shape_at(dim, 2, corners))
    grown = np.einsum("idmq,jdmq->mqij", np.broadcast_to(inverse, (*inverse.shape[:3], now.shape[3])), now)
    share = np.linalg.det(grown)
    return np.asarray((share < LEAST_MEASURE_SHARE).any(axis=1))
