"""Cells of degree 2 with midpoints, whose nodes are moved onto the surface, its rim and boundaries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.plugin import Bools, CutMesh, Floats, Ints, Scene
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.elements import EDGES_OF, NODES, shape_at
from cpmkit_fem.location import nearest_cells
from cpmkit_fem.rim import points_outside_rim, rim_facets, steps_outward
from cpmkit_fem.surface_mapping import jacobians, measure_and_pseudoinverse

#: A node stays on its flat cell if it would move by more than this share of an edge.
MOVED_EDGE_SHARE = 0.25
#: Least measure of a curved cell at any point over that of the flat cell; else its nodes stay.
LEAST_MEASURE_SHARE = 0.2
#: Rounds in which nodes of inverted cells move back, at first midpoints alone; in the end all cells are flat.
ROUNDS_OF_UNTANGLING, ROUNDS_OF_STRAIGHTENING = 20, 4
#: Rounds that project a node onto two boundaries, or a boundary and the rim, each nearer to the rim by a factor.
ROUNDS_OF_MEETING, NEARER = 5, 0.125


def add_midpoints(mesh: CellMesh) -> CellMesh:
    """Return ``mesh``, of degree 1, as a mesh of degree 2 with nodes at the midpoints of its straight edges."""
    k = mesh.manifold_dim + 1
    pairs = np.sort(mesh.corners[:, EDGES_OF[mesh.manifold_dim]].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middles = len(mesh.nodes) + number.reshape(len(mesh.cells), -1)
    cells = np.hstack([mesh.corners, middles])
    assert cells.shape[1] == NODES[mesh.manifold_dim, 2]
    assert mesh.corners.shape[1] == k
    return CellMesh(np.concatenate([mesh.nodes, mesh.nodes[edges].mean(axis=1)]), cells, mesh.manifold_dim, 2)


def fit_curved_cells(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> tuple[CellMesh, Floats]:
    """Return the mesh with nodes moved onto the surface, rim and boundaries, and (n,) their distances from that goal.

    ``mesh`` is of degree 2 with straight edges; ``cut`` is None without boundaries. Nodes near the rim and boundaries
    move with these, so that thin cells keep their shape. A node stays where it is if it would move farther than
    :data:`MOVED_EDGE_SHARE` of an edge or invert a cell.
    """
    lines, wanted = _line_facets_and_targets(scene, mesh, cut)
    merged, number = _merge_nodes(mesh)
    reach = _edge_at_nodes(merged)[number]
    others = np.setdiff1d(np.arange(len(mesh.nodes)), lines)
    if mesh.manifold_dim == 2 and len(lines):
        wanted[others] += _displace_neighbours(mesh, lines, wanted - mesh.nodes, mesh.nodes[others], reach)
    wanted[others] = scene.surface.closest_point(wanted[others]).points
    far = np.linalg.norm(wanted - mesh.nodes, axis=1) > MOVED_EDGE_SHARE * reach
    places = wanted.copy()
    places[far] = mesh.nodes[far]
    merged_places = merged.nodes.copy()
    merged_places[number] = places
    nodes = _untangle(merged, merged_places)[number]
    return replace(mesh, nodes=nodes, curved=True), np.linalg.norm(nodes - wanted, axis=1)


def _line_facets_and_targets(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> tuple[Ints, Floats]:
    """Return the facets (f, c) on the rim, then on boundaries, and the targets (n, d) of all nodes of ``mesh``.

    Targets of nodes on boundaries are on the boundary, or near all boundaries that meet there; those of ends of
    boundaries at the rim near the rim too. Those of midpoints of rim edges are on the rim. Other nodes, corners of the
    rim among them, are their own targets. ``mesh`` is of degree 2; ``cut`` is None without boundaries.
    """
    wanted, none = mesh.nodes.copy(), np.zeros((0, mesh.manifold_dim), dtype=np.int64)
    rim, opposite = rim_facets(mesh, none if cut is None else cut.edges)
    k = mesh.manifold_dim
    if len(rim) and k > 1:
        outside = mesh.nodes[rim[:, k:]] + steps_outward(mesh, rim, opposite)[:, None]
        wanted[rim[:, k:].ravel()] = scene.surface.closest_point(outside.reshape(-1, mesh.nodes.shape[1])).points
    if cut is None:
        return rim, wanted
    of_edges = [np.unique(mesh.facet_nodes(cut.edges[cut.owner == k])) for k in range(len(scene.boundaries))]
    of_boundary = [np.union1d(nodes, cut.points.get(number, nodes)) for number, nodes in enumerate(of_edges)]
    on, count = np.unique(np.concatenate(of_boundary), return_counts=True)
    ends = np.intersect1d(on, rim[:, : mesh.manifold_dim])
    outward = np.zeros_like(wanted)
    outward[rim[:, : mesh.manifold_dim]] = (
        points_outside_rim(mesh, rim, opposite) - mesh.nodes[rim[:, : mesh.manifold_dim]].mean(axis=1)
    )[:, None]
    meeting = np.union1d(on[count > 1], ends)
    for turn in range(ROUNDS_OF_MEETING):
        for boundary, nodes in zip(scene.boundaries, of_boundary, strict=True):
            at = nodes if turn == 0 else np.intersect1d(nodes, meeting)
            if len(at):
                wanted[at] = scene.surface.closest_point(boundary.source.closest_point(wanted[at]).points).points
        if len(ends):
            wanted[ends] = scene.surface.closest_point(wanted[ends] + NEARER**turn * outward[ends]).points
    return np.concatenate([rim, mesh.facet_nodes(cut.edges)]), wanted


def _displace_neighbours(mesh: CellMesh, lines: Ints, moved: Floats, points: Floats, reach: Floats) -> Floats:
    """Return displacements (k, d) of ``points`` (k, d) near the edges ``lines`` (f, 3), whose nodes are displaced.

    ``moved`` (n, d) are displacements of all nodes. A point moves as its nearest place on a line, with a factor that
    decreases linearly to zero at the ``reach`` (n,) of the line's nodes. Of a line the midpoint is the last node.
    """
    line, local = nearest_cells(mesh.nodes, lines[:, :2], points)
    ends = lines[line]
    feet = np.einsum("kc,kcd->kd", local, mesh.nodes[ends[:, :2]])
    share = 1 - np.linalg.norm(points - feet, axis=1) / reach[ends].max(axis=1)
    at_feet = np.einsum("ck,kcd->kd", shape_at(1, 2, local[:, 1:].T).values, moved[ends])
    return np.asarray(np.maximum(share, 0.0)[:, None] * at_feet)


def _merge_nodes(mesh: CellMesh) -> tuple[CellMesh, Ints]:
    """Return the mesh with nodes at equal places merged, and the new number (n,) of each node."""
    nodes, number = np.unique(mesh.nodes, axis=0, return_inverse=True)
    number = number.ravel()
    return replace(mesh, nodes=nodes, cells=number[mesh.cells]), number


def _edge_at_nodes(mesh: CellMesh) -> Floats:
    """Return (n,) for each node the least, over its cells, of the cell's longest edge."""
    length = np.full(len(mesh.nodes), np.inf)
    np.minimum.at(length, mesh.cells, mesh.longest_edges[:, None])
    return length


def _untangle(mesh: CellMesh, wanted: Floats) -> Floats:
    """Return the nodes at their ``wanted`` places (n, d), those of cells that would be inverted moved back.

    Midpoints move back first, to the middle of their corners; all nodes do if :data:`ROUNDS_OF_UNTANGLING` are too few.
    """
    nodes, k = wanted.copy(), mesh.manifold_dim + 1
    for turn in range(ROUNDS_OF_UNTANGLING):
        folded = mesh.cells[_inverted_cells(mesh, nodes)]
        if not len(folded):
            return nodes
        if turn >= ROUNDS_OF_STRAIGHTENING:
            nodes[folded] = mesh.nodes[folded]
        nodes[folded[:, k:]] = nodes[folded[:, EDGES_OF[mesh.manifold_dim]]].mean(axis=2)
    return mesh.nodes


def _inverted_cells(mesh: CellMesh, nodes: Floats) -> Bools:
    """Return (m,) which cells with ``nodes`` (n, d) are inverted or below LEAST_MEASURE_SHARE of the flat measure.

    Their measures are compared at the nodes; ``mesh``, of degree 2, has the flat cells.
    """
    dim = mesh.manifold_dim
    ends = np.vstack([np.zeros(dim), np.eye(dim)])
    corners = np.concatenate([ends, ends[EDGES_OF[dim]].mean(axis=1)]).T
    flat = shape_at(dim, 1, corners[:, :1])
    inverse = measure_and_pseudoinverse(jacobians(mesh.nodes, mesh.corners, flat))[1]
    now = jacobians(nodes, mesh.cells, shape_at(dim, 2, corners))
    grown = np.einsum("idmq,jdmq->mqij", np.broadcast_to(inverse, (*inverse.shape[:3], now.shape[3])), now)
    share = np.linalg.det(grown)
    return np.asarray((share < LEAST_MEASURE_SHARE).any(axis=1))
