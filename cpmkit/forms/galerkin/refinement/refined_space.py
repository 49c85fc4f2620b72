"""Truncated hierarchical splines as a function space: finer splines where the solution needs them.

The splines of level l are built over the samples of the region of level l and of a halo: the patches of level l - 1
that share an unknown with a patch of that region. Thus the level has all patches that read an unknown of the region,
and nodes have the same unknowns as if the whole manifold were subdivided.

An active spline of a coarse level is on a finer level a sum of finer splines, by the two-scale relation; truncation
removes from the sum those that are candidates of the finer level. With c the coefficients of the active splines,

    R_0 = I on the active splines,    R_l = D_l P_l R_(l-1) + I on the active splines of level l,

D_l being zero for the candidates of level l and one for the other splines. On a patch of level l, u is the sum of the
splines of that level with the coefficients R_l c. The splines sum to one, and a polynomial has the coefficients that it
has on each level.

A patch of level l, magnified by 2^l about a fixed point of the lattice, lies on a lattice of spacing h as the patches
of level 0 do. All levels together, each magnified, form one space of splines like any other; its N unknowns are the
splines of each level that the patches of that level read, one level after another. The representation R (N, n) maps
the coefficients of the n active splines to these N coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.dof_map import DofMap, build_patches, distinct_pairs, dof_map_from_patches
from cpmkit.forms.galerkin.options import Stabilisation
from cpmkit.forms.galerkin.refinement.regions import Regions, codes_of_cells, shift_of
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.levels import prolongation_between
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.forms.galerkin.space.spline_space import build_spline_space
from cpmkit.grid.lattice import find_codes
from cpmkit.linear.multigrid.solver import Level
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.types import Bools, Floats, Ints, SparseMatrix


@dataclass(frozen=True, eq=False)
class LevelSplines:
    """The splines of one level."""

    #: The dof map over the region of the level and its halo; ``dof_map.patch`` (s,) are patches of the samples there.
    dof_map: DofMap
    rows: Ints  #: (s,): the numbers of these samples, ascending.
    inside: Bools  #: (p,): whether each patch is in the region of this level.
    subdivided: Bools  #: (p,): whether each patch is in the region of the next level.
    #: csr_array (n, m): prolongation from the splines of the level before; None for level 0.
    prolongation: SparseMatrix | None

    @property
    def candidates(self) -> Bools:
        """(n,) whether a spline is a candidate: all patches that read it lie in the region of this level."""
        return ~self.is_read_by(~self.inside)

    @property
    def active(self) -> Bools:
        """(n,) whether a spline is active: a candidate that a patch outside the region of the next level reads."""
        return self.candidates & self.is_read_by(~self.subdivided)

    def is_read_by(self, patches: Bools) -> Bools:
        """Return (n,) whether each spline is read by a patch for which ``patches`` (p,) is true."""
        is_read = np.zeros(self.dof_map.size, dtype=bool)
        is_read[self.dof_map.unknowns[patches]] = True
        return is_read

    def patch_of(self, samples: Ints) -> Ints:
        """Return (k,) the patch of each of the ``samples`` (k,), which are among :attr:`rows`."""
        return np.asarray(self.dof_map.patch[np.searchsorted(self.rows, samples)])


def level_splines(first: DofMap, points: Floats, corners: Any, cell: Any, regions: Regions) -> list[LevelSplines]:
    """Return the splines of all levels, where ``regions`` are the subdivided cells.

    ``first`` is the dof map of level 0, over all samples; ``points`` (q, d) are the samples, relative to the lattice's
    origin, and ``cell`` (q,) int32 their mesh cells. ``corners`` (m, k) int: the vertices of the cells after cutting.
    """
    everywhere = np.ones(len(first.cells), dtype=bool)
    subdivided = _is_subdivided(first.cells, everywhere, regions, 0)
    levels = [LevelSplines(first, np.arange(len(points)), everywhere, subdivided, None)]
    for number in range(1, regions.finest + 1):
        levels.append(_finer_level(levels[-1], number, points, corners, cell, regions))
    return levels


def _finer_level(
    coarse: LevelSplines, number: int, points: Floats, corners: Any, cell: Any, regions: Regions
) -> LevelSplines:
    """Return the splines of level ``number``, the level after ``coarse``; see :func:`level_splines`."""
    in_region_or_halo = coarse.is_read_by(coarse.subdivided)[coarse.dof_map.unknowns].any(axis=1)
    chosen = in_region_or_halo[coarse.dof_map.patch]
    rows, coarse_patch = coarse.rows[chosen], coarse.dof_map.patch[chosen]
    cells_of_rows = regions.cells(points[rows], number)
    patch, first, touching = build_patches(codes_of_cells(cells_of_rows), corners, cell[rows])
    cells, parent = cells_of_rows[first], coarse_patch[first]
    spacing, isolated = coarse.dof_map.spacing / 2, np.zeros(len(first), dtype=bool)
    dof_map = dof_map_from_patches(spacing, cells, touching, patch, isolated)
    inside = coarse.subdivided[parent]
    prolongation = prolongation_between(dof_map, coarse.dof_map, parent).astype(np.float64)
    return LevelSplines(dof_map, rows, inside, _is_subdivided(cells, inside, regions, number), prolongation)


def _is_subdivided(cells: Ints, inside: Bools, regions: Regions, level: int) -> Bools:
    """Return (p,) whether patches with the ``cells`` (p, d) of a level are subdivided; only those ``inside`` can be."""
    if level >= regions.finest:
        return np.zeros(len(cells), dtype=bool)
    return inside & (find_codes(regions.subdivided[level], codes_of_cells(cells)) >= 0)


def representations(levels: Sequence[LevelSplines], cap: int) -> list[SparseMatrix]:
    """Return the representations R_l (n_l, n), l = 0 to ``cap``, for the space whose finest level is ``cap``.

    R_l maps coefficients of the n active splines, level by level, to those of the n_l splines of level l.
    """
    actives = [level.candidates if number == cap else level.active for number, level in enumerate(levels[: cap + 1])]
    starts = np.cumsum([0, *(int(active.sum()) for active in actives)])
    matrices: list[SparseMatrix] = []
    for level, active, start in zip(levels, actives, starts, strict=False):
        rows: Ints = np.flatnonzero(active)
        entries = np.ones(len(rows)), (rows, start + np.arange(len(rows)))
        matrix = csr_array(entries, shape=(level.dof_map.size, starts[-1]))
        if level.prolongation is not None:
            matrix = matrix + diags_array(1.0 - level.candidates) @ (level.prolongation @ matrices[-1])
        matrices.append(matrix.tocsr())
    return matrices


def prolongation_to_level(levels: Sequence[LevelSplines], cap: int, coarser: SparseMatrix) -> SparseMatrix:
    """Return the prolongation from the space with the finest level ``cap - 1`` to that with the finest level ``cap``.

    The result is (m, n) for m and n active splines. ``coarser`` is the last of the :func:`representations` of the
    coarser space. Truncated splines have the same coefficients on finer levels; those of level ``cap`` follow from the
    two-scale relation.
    """
    before = [level.candidates if number == cap - 1 else level.active for number, level in enumerate(levels[:cap])]
    stays = np.concatenate([level.active[candidates] for level, candidates in zip(levels[:cap], before, strict=True)])
    rows = np.flatnonzero(stays)
    same = csr_array((np.ones(len(rows)), (np.arange(len(rows)), rows)), shape=(len(rows), len(stays)))
    level = levels[cap]
    assert level.prolongation is not None
    return vstack([same, (level.prolongation @ coarser)[level.candidates]], format="csr")


@dataclass(frozen=True, eq=False, kw_only=True)
class RefinedDofMap(DofMap):
    """A dof map whose patches belong to several levels; its cells and nodes are those of the magnified levels."""

    levels: Ints  #: (p,): the level of each patch.
    node_levels: Ints  #: (n,): the level of each unknown.

    @property
    def places(self) -> Floats:
        """(n, d) the node of each unknown, not magnified, relative to the origin of the lattice."""
        level = self.node_levels[:, None]
        return np.asarray(0.5**level * self.spacing * self.nodes - shift_of(self.spacing, level))

    def magnify(self, patch: Ints, points: Floats) -> Floats:
        """Return ``points`` (..., d), each in the patch ``patch`` (...), mapped to the magnified lattice."""
        level = self.levels[patch][..., None]
        return np.asarray(2.0**level * (points + shift_of(self.spacing, level)))

    def reduce(self, patch: Ints, points: Floats) -> Floats:
        """Return the points that :meth:`magnify` maps to ``points`` (..., d), each in the patch ``patch`` (...)."""
        level = self.levels[patch][..., None]
        return np.asarray(0.5**level * points - shift_of(self.spacing, level))

    def magnification(self, patch: Any) -> Floats:
        """Return the factor (k,) by which the patches ``patch`` (k,) are magnified."""
        return np.asarray(2.0 ** self.levels[patch])


@dataclass(frozen=True, eq=False)
class RefinedSamples(QuantisedSamples):
    """Samples whose places are stored on the magnified lattice; their points are returned on the manifold."""

    dof_map: RefinedDofMap  #: The dof map of these samples.

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return the points (..., d) on the manifold of the samples ``rows`` (...)."""
        return self.dof_map.reduce(self.dof_map.patch[rows], super().points_at(rows))


@dataclass(frozen=True, eq=False)
class RefinedSpace(FunctionSpace):
    """Truncated hierarchical splines; :attr:`splines` are the magnified levels."""

    levels: Sequence[LevelSplines]  #: The splines of each level.
    #: sequence of (k_l,) int64: the splines of each level that :attr:`splines` contains, in its order.
    used: Sequence[Ints]
    regions: Regions  #: The subdivided cells.
    passes: int = 0  #: Number of solves of the scene that led to the regions.
    #: The factor by which refinement was expected, after the first solve, to reduce the number of unknowns.
    gain: float = 0.0

    @property
    def base_dof_map(self) -> DofMap:
        """The dof map of level 0 over all samples."""
        return self.levels[0].dof_map

    @property
    def finest_spacing(self) -> float:
        """The spacing of the finest level."""
        return float(self.spacing / 2**self.regions.finest)

    @property
    def spline_count(self) -> int:
        """Number of active splines."""
        return int(self.representation.shape[1])

    @property
    def level_sizes(self) -> tuple[int, ...]:
        """Number of active splines of each level."""
        return tuple(int(level.active.sum()) for level in self.levels)

    @cached_property
    def representation(self) -> SparseMatrix:
        """R (N, n), whose columns are the active splines as coefficients of :attr:`splines`."""
        by_level = representations(self.levels, self.regions.finest)
        return vstack([matrix[used] for matrix, used in zip(by_level, self.used, strict=True)], format="csr")

    def to_coefficients(self, u: Floats) -> Floats:
        """Return R u, the coefficients (N, k) in :attr:`splines` of the functions with the unknowns ``u`` (n, k)."""
        return np.ascontiguousarray(self.representation @ u)

    def restrict_loads(self, loads: Floats) -> Floats:
        """Return R' times ``loads`` (N, k): the loads (n, k) of the active splines."""
        return np.asarray(self.representation.T @ loads)

    def restrict_matrix(self, matrix: SparseMatrix) -> SparseMatrix:
        """Return R' A R (n, n) of a symmetric ``matrix`` A (N, N), symmetric to the last bit."""
        product = (self.representation.T @ (matrix @ self.representation)).tocsr()
        return ((product + product.T) * 0.5).tocsr()

    def restrict_rows(self, rows: SparseMatrix) -> SparseMatrix:
        """Return ``rows`` R (k, n) from ``rows`` (k, N) that evaluate :attr:`splines`."""
        return (rows @ self.representation).tocsr()

    def gradient_load(self, values: Floats) -> Floats:
        """Raise a SceneError: a weak divergence depends on the spacing, of which refined splines have several."""
        raise SceneError("refine='auto' takes no divergence as a right-hand side; use refine='off'.")

    @cached_property
    def refined_levels(self) -> list[Level]:
        """The multigrid levels between the spaces whose finest level is ``regions.finest``, ..., 1, 0."""
        levels, patch = self.levels, self.dof_map.patch[self.interior :]
        rows = np.arange(self.interior, len(self.splines.samples))
        level_of_row = self.dof_map.levels[patch]  # type: ignore[attr-defined]
        steps = []
        for finest in range(self.regions.finest, 0, -1):
            own, coarser = representations(levels, finest), representations(levels, finest - 1)
            read = [
                own[level][np.unique(levels[level].dof_map.unknowns[levels[level].patch_of(rows[here])])].indices
                for level in range(finest + 1)
                if len(here := np.flatnonzero(np.minimum(level_of_row, finest) == level))
            ]
            strip = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *read])).astype(np.int64)
            steps.append(Level(prolongation_to_level(levels, finest, coarser[-1]), strip))
        return steps

    def describe(self) -> dict[str, Any]:
        """Return the number of splines on each level, the number of solves, and the expected gain in words."""
        sizes = list(self.level_sizes)
        text = f"refined cells are expected to need {self.gain:.2g} times fewer unknowns for the same error"
        if self.regions.finest:
            numbers = ", ".join(f"{size:,}" for size in sizes)
            text = f"on: {text}; {numbers} unknowns on levels 0 to {self.regions.finest}"
        else:
            text = f"off: {text}"
        return {"refined_levels": sizes, "refinement_passes": self.passes, "refinement": text}

    def arrays(self) -> dict[str, Any]:
        """Return the nodes of level 0, and the subdivided cells as a table."""
        return {**super().arrays(), "parted_cells": self.regions.table()}  # the key in saved files

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in words how a ``saved`` space differs, in nodes of level 0 or subdivided cells; empty if equal."""
        if difference := super().differs_from(saved):
            return difference
        same = np.array_equal(self.regions.table(), saved.get("parted_cells", ()))
        return "" if same else "it was refined elsewhere"


def build_refined_space(
    samples: Samples,
    interior: int,
    corners: Any,
    levels: Sequence[LevelSplines],
    regions: Regions,
    stabilisation: Stabilisation,
    tied: Ints,
) -> RefinedSpace:
    """Return the function space of truncated hierarchical splines over the ``levels``.

    ``samples``, ``interior``: all samples, and the number of samples on the manifold and on no boundary. ``corners``
    (m, k) int: the vertices of the mesh cells after cutting. ``tied`` (t, 2): pairs of samples at the lips of ties.
    ``levels``, ``regions``, ``stabilisation``: the attributes of :class:`RefinedSpace`.
    """
    dof_map, used = _build_refined_dof_map(samples, corners, levels, regions)
    magnified = Samples(dof_map.magnify(dof_map.patch, samples.points), samples.weights, samples.normals, samples.cell)
    dof_map = replace(dof_map, tied=distinct_pairs(dof_map.patch[tied], len(dof_map.cells)))
    splines = build_spline_space(dof_map, RefinedSamples.of(magnified, dof_map))
    return RefinedSpace(splines, interior, stabilisation, levels, used, regions)


def _build_refined_dof_map(
    samples: Samples, corners: Any, levels: Sequence[LevelSplines], regions: Regions
) -> tuple[RefinedDofMap, list[Ints]]:
    """Return the dof map of the magnified levels, and for each level the numbers (k_l,) of its splines in that map."""
    level_of_sample = regions.levels_at(samples.points)
    code, cell_count = np.empty(len(samples), dtype=np.int64), 0
    for number in range(len(levels)):
        rows = np.flatnonzero(level_of_sample == number)
        lattice_cells = codes_of_cells(regions.cells(samples.points[rows], number))
        distinct, place = np.unique(lattice_cells, return_inverse=True)
        code[rows] = cell_count + place
        cell_count += len(distinct)
    patch, first, touching = build_patches(code, corners, samples.cell)
    level_of_patch = level_of_sample[first]
    d = samples.points.shape[1]
    cells = np.empty((len(first), d), dtype=np.int64)
    unknowns = np.empty((len(first), 3**d), dtype=np.int32)
    nodes, used, size = [], [], 0
    for number, level in enumerate(levels):
        on_level = np.flatnonzero(level_of_patch == number)
        patches = level.patch_of(first[on_level])
        cells[on_level] = level.dof_map.cells[patches]
        read, place = np.unique(level.dof_map.unknowns[patches], return_inverse=True)
        unknowns[on_level] = size + place.reshape(len(on_level), 3**d)
        nodes.append(level.dof_map.nodes[read])
        used.append(read)
        size += len(read)
    level_of_node = np.repeat(np.arange(len(levels)), [len(read) for read in used])
    spacing, all_nodes = levels[0].dof_map.spacing, np.concatenate(nodes)
    dof_map = RefinedDofMap(
        spacing, cells, unknowns, all_nodes, touching, patch, levels=level_of_patch, node_levels=level_of_node
    )
    return dof_map, used
