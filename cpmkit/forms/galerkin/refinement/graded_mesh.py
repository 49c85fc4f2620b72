"""A mesh whose triangles are as small as the lattice cells that they lie in, and its samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.galerkin.sample_mesh import SampleMesh, Samples
from cpmkit.forms.galerkin.samples.edges import edges_of
from cpmkit.forms.galerkin.samples.quadrature import samples_of
from cpmkit.forms.galerkin.samples.subdivision import halved
from cpmkit.protocols import Bools, Floats, Ints

#: Edges are looked at from these places between their ends.
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


def graded(mesh: SampleMesh, regions: Regions, spacings: float) -> SampleMesh:
    """Return flat triangles with their edges halved that are longer than ``spacings`` times the spacing around them."""
    done = []
    while True:
        edges = edges_of(mesh)
        long = _long(mesh.vertices, edges.ends, regions, spacings)
        open_cells = long[edges.of_cells].any(axis=1)
        done.append(mesh.cells[~open_cells])
        if not open_cells.any():
            return replace(mesh, cells=np.concatenate(done))
        mesh = replace(mesh, cells=mesh.cells[open_cells])
        edges = edges_of(mesh)
        long = _long(mesh.vertices, edges.ends, regions, spacings)
        middle = np.full(len(edges.ends), -1)
        middle[long] = len(mesh.vertices) + np.arange(long.sum())
        mesh = halved(mesh, edges, middle, mesh.vertices[edges.ends[long]].mean(axis=1))


def _long(vertices: Floats, ends: Ints, regions: Regions, spacings: float) -> Bools:
    first, second = vertices[np.sort(ends, axis=1)].transpose(1, 0, 2)
    places = [(1 - share) * first + share * second for share in SHARES]
    level = np.max([regions.levels_around(one) for one in places], axis=0)
    length = np.linalg.norm(second - first, axis=1)
    return np.asarray(length > spacings * regions.spacing * 0.5**level)


def graded_samples(mesh: SampleMesh, regions: Regions, clipped: bool, further: Samples | None) -> Samples:
    """Return the samples of triangles, those of one after those of another, and ``further`` ones behind them.

    Triangles that are clipped are so at the knot planes of the finest level that their corners or middle lie in.
    """
    if not clipped:
        return samples_of(mesh, None, further)
    middle = mesh.vertices[mesh.cells].mean(axis=1)
    corners = [mesh.vertices[one] for one in mesh.cells.T]
    level = np.max([regions.levels(one) for one in (middle, *corners)], axis=0)
    parts = [_clipped(mesh, np.flatnonzero(level == one), regions, one) for one in range(regions.finest + 1)]
    whole = [np.concatenate([getattr(one, name) for one in parts]) for name in ("points", "weights", "normals", "cell")]
    order = np.argsort(whole[3], kind="stable")
    behind = [] if further is None else [further.points, further.weights, further.normals, further.cell]
    own = [one[order] for one in whole]
    return Samples(*(own if not behind else [np.concatenate(pair) for pair in zip(own, behind, strict=True)]))


def _clipped(mesh: SampleMesh, chosen: Ints, regions: Regions, level: int) -> Samples:
    shift = shift_of(regions.spacing, level)
    midpoints = None if mesh.midpoints is None else mesh.midpoints[chosen] + shift
    moved = replace(mesh, vertices=mesh.vertices + shift, cells=mesh.cells[chosen], midpoints=midpoints)
    found = samples_of(moved, regions.spacing / 2**level)
    return Samples(found.points - shift, found.weights, found.normals, chosen[found.cell])


def shift_of(spacing: float, level: Any) -> Any:
    """Return how far before that of level 0 the lattice of a level has its node (0, ..., 0), along every axis."""
    return 0.5 * spacing * (1 - 0.5**level)
