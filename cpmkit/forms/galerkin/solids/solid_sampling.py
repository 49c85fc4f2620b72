"""Sampling of a solid: its patches (connected parts in lattice cells), their quadrature, and samples on the skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.errors import ResolutionError, SceneError, place
from cpmkit.forms.galerkin.conditions.imposed_conditions import imposed_conditions, part_function
from cpmkit.forms.galerkin.dof_map import (
    DofMap,
    connected_pieces,
    distinct_pairs,
    dof_map_from_patches,
)
from cpmkit.forms.galerkin.enrichment.plane_tips import TipSamples, gathered_at_tips, plane_tip_disc, tip_samples
from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction, functions_in_discs
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.scene_sampling import SampledScene
from cpmkit.forms.galerkin.solids.boundaries_inside import (
    GRADED_HALVINGS,
    boundaries_inside,
    check_sectors,
    left_of_normals,
    split_where_curves_meet,
    welded,
    with_curves_inside,
)
from cpmkit.forms.galerkin.solids.skin import Skin, flat_parts, has_reentrant_edges, skin_of
from cpmkit.forms.galerkin.solids.skin_samples import skin_samples
from cpmkit.forms.galerkin.solids.surfaces_inside import with_surfaces_inside
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import Lattice, lattice_of
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.skin_pieces import skin_pieces
from cpmkit.mesh.solid_moments import FULL_POINTS, MOMENTS, gauss_points, gauss_weights
from cpmkit.mesh.solid_pieces import SolidPatches, solid_patches
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints

#: Largest sum of normals over a column of cells, in squared spacings, for which a skin is closed: rounding.
OPEN_FLUX = 1e-7
#: The share of a face or a cell that is inside the solid differs by at most this from [0, 1] where arcs bulge.
BULGE_SHARE = 0.05
#: A solid is thin if more than this share of its volume is thinner than so many spacings. In slabs of .05 and .1
#: spacings with values on the skin errors are of order 2 until they are tiny, and estimates that expect order 3 were
#: down to a sixth of the error; in slabs of .5 spacings estimates were right.
LARGEST_THIN_SHARE, THIN_SPACINGS = 0.5, 1 / 3


@dataclass(frozen=True, eq=False)
class SampledSolid(SampledScene):
    """A solid with samples, Gauss points of lattice cells, and its dof map; the mesh is that of its skin."""

    patches: SolidPatches  #: The connected parts of the solid in lattice cells.
    dof_map: DofMap  #: The dof map of the samples.
    near_tips: TipSamples | None = None  #: The quadrature of products with singular functions near tips.

    @property
    def ties(self) -> Floats:
        """(0, d, d): a solid has no creases."""
        d = self.surface.dim
        return np.zeros((0, d, d))

    @cached_property
    def slow_part_of_solid(self) -> str:
        """In words, where gradients are unbounded, or thin parts; else empty."""
        if has_reentrant_edges(self.mesh):
            return "the solid has reentrant corners or edges"
        thin = self._thin_share
        return f"{thin:.0%} of the solid is thinner than a third of the spacing" if thin > LARGEST_THIN_SHARE else ""

    @property
    def _thin_share(self) -> float:
        """Share of the volume in thin patches; a patch is as thick as twice its volume over the area of its skin."""
        patches, spacing = self.patches, self.lattice.spacing
        count, d = len(patches.cells), self.surface.dim
        volumes = np.bincount(self.dof_map.patch, self.samples.weights, minlength=count) / spacing**d
        areas = np.bincount(patches.of_piece, norms(patches.pieces.normals), minlength=count)
        return float(volumes[2 * volumes < THIN_SPACINGS * areas].sum() / volumes.sum())

    @property
    def has_near_parts(self) -> bool:
        """Whether a lattice cell has several parts of the solid, or the solid has several pieces."""
        several = self.patches.cut > len(self.patches.table.cells)
        return several or connected_pieces(self.dof_map)[0] > 1


def sample_solid(scene: Scene, options: Options[GalerkinOptions]) -> SampledSolid:
    """Return the samples of a scene on a solid.

    Raises SceneError if the boundary of the solid is not closed or crosses itself, or a condition cannot be imposed,
    see :func:`imposed_conditions`; ResolutionError if a boundary inside is not resolved.
    """
    lattice = lattice_of(scene.surface, options.spacing, options.origin)
    surface = localize(scene.surface, lattice.origin)
    oriented = [scene.oriented(boundary) for boundary in scene.boundaries]
    is_graded = options.own.tips == "singular"
    skin = _whole_skin(scene, surface, oriented, lattice, is_graded)
    fine, coarse = skin.facets
    names, exact = [boundary.name for boundary in scene.boundaries], bool(skin.is_flat.any())
    pieces = [
        skin_pieces(mesh, lattice.spacing, exact, check_sectors(skin, mesh, names, lattice) if names else None)
        for mesh in (fine, coarse)
        if mesh is not None
    ]
    patches, further = solid_patches(pieces[0]), pieces[1] if len(pieces) > 1 else None
    moments, sums = patches.moments(further)
    _check_skin(patches, moments, sums, lattice)
    if names:
        _check_parts(patches, skin, lattice)
    inside = _inside_samples(patches, moments, lattice.spacing)
    boundary, left = skin_samples(skin, patches, lattice.spacing)
    tips = _tips_of(skin) if is_graded else []
    if tips:
        shortest = lattice.spacing * 0.5 ** (GRADED_HALVINGS - 1)
        boundary = gathered_at_tips(boundary, [tip for _, tip, _ in tips], shortest)
    conditions = imposed_conditions(scene, boundary, left, surface, lattice)
    singular: tuple[SingularFunction, ...] = ()
    near, warnings = None, skin.warnings
    if tips:
        discs = [
            (number, plane_tip_disc(tip, number, others, boundary, inside, patches.cells, lattice.spacing))
            for number, tip, others in tips
        ]
        singular, tip_warnings = functions_in_discs(discs, boundary, conditions, lattice)
        warnings += tip_warnings
    if singular:
        discs_in_use = list({id(function.disc): function.disc for function in singular}.values())
        near = tip_samples(discs_in_use, patches, inside, lattice.spacing)
    samples = Samples.join([inside, boundary.as_samples])
    none = np.zeros(0, dtype=np.int64)
    outer = Mesh.of(fine.vertices, fine.cells[np.arange(len(fine.cells)) % len(skin.owner) < skin.count])
    return SampledSolid(
        lattice=lattice,
        surface=surface,
        sources=(),
        oriented=oriented,
        mesh=outer,
        points={},
        geometry=skin.geometry,
        warnings=warnings,
        corners=outer.cells,
        half=HalfFacets(none, none, none, none),
        samples=samples,
        boundary=boundary,
        left=left,
        conditions=conditions,
        winding=np.ones(len(outer.cells), dtype=np.int8),
        singular=singular,
        patches=patches,
        dof_map=_dof_map(patches, samples.cell, options),
        near_tips=near,
    )


def _tips_of(skin: Skin) -> list[tuple[int, Floats, Floats]]:
    """Return the ends of curves inside a plane solid: the curve's number, the place (2,), and the others (k, 2)."""
    mesh, first, tips = skin.mesh, np.arange(len(skin.twin)) < skin.twin, []
    for number in range(int(skin.owner.max()) + 1):
        own, past = (mesh.cells[first & (skin.owner == number) & (skin.beyond_tip == is_past)] for is_past in (0, 1))
        vertices, count = np.unique(own, return_counts=True)
        tips += [(number, mesh.vertices[tip]) for tip in np.intersect1d(vertices[count == 1], past)]
    at = np.array([tip for _, tip in tips]).reshape(-1, mesh.dim)
    return [(number, tip, np.delete(at, k, axis=0)) for k, (number, tip) in enumerate(tips)]


def _whole_skin(
    scene: Scene, solid: LocalSource, oriented: Sequence[OrientedBoundary], lattice: Lattice, is_graded: bool
) -> Skin:
    """Return the skin of a scene's ``solid`` with the scene's boundaries inside, with short cells near tips or not."""
    parts, inside = flat_parts(solid, lattice), boundaries_inside(scene, lattice)
    part_at, names = part_function(scene, lattice), [boundary.name for boundary in scene.boundaries]
    if not inside:
        return skin_of(solid, parts, lattice, part_at)
    if solid.dim == 3:
        skin = skin_of(solid, parts, lattice, part_at, divided=True)
        return with_surfaces_inside(
            skin, inside, names, solid, lambda number, mesh: left_of_normals(mesh, oriented[number], lattice), lattice
        )
    curves = split_where_curves_meet(parts, inside, names, solid, lattice, is_graded)
    skin = skin_of(solid, curves.skin, lattice, part_at)
    whole = with_curves_inside(skin, curves.inside, curves.extensions, oriented, solid, lattice)
    return welded(whole, curves.points)


def _check_skin(patches: SolidPatches, moments: Floats, sums: Floats, lattice: Lattice) -> None:
    """Raise SceneError, with a place, if the skin is not closed or crosses itself."""
    shares = np.stack([patches.face_shares[0][:, 0], *patches.face_shares[1].T], axis=1)
    row = np.repeat(np.arange(len(patches.table.cells)), np.diff(patches.patch_starts))
    outside = np.maximum(-shares, shares - 1).max(axis=1)
    np.maximum.at(outside, row, np.maximum(-moments[:, 0, 0], moments[:, 0, 0] - 1))
    for excess, most, words in (
        (np.abs(sums), OPEN_FLUX, "is not closed near {}; close it there"),
        (outside, BULGE_SHARE, "crosses itself, or two parts of it overlap, near {}; move them apart"),
    ):
        worst = int(np.argmax(excess))
        if excess[worst] > most:
            at = place(lattice.to_scene(lattice.spacing * patches.table.cells[worst]))
            raise SceneError(f"the boundary of the solid {words.format(at)}, or use form='collocation'.")


def _check_parts(patches: SolidPatches, skin: Skin, lattice: Lattice) -> None:
    """Raise ResolutionError, with a place, if a boundary inside does not separate the patches on its two sides.

    Then the parts of a lattice cell on its two sides were merged, or one patch lies on both sides before a tip.
    """
    pieces = patches.pieces
    facet = pieces.facet % len(skin.owner)
    own = np.flatnonzero((skin.owner[facet] >= 0) & ~pieces.in_face)
    facet, patch = facet[own], patches.of_piece[own]
    leaking = np.zeros(len(patches.table.cells), dtype=bool)
    leaking[patches.table.find(pieces.cell[own])] = True
    leaking &= patches.merged
    pairs, number = np.unique(patch * (skin.owner.max() + 1) + skin.owner[facet], return_inverse=True)
    counts = np.bincount(number, minlength=len(pairs))
    left, beyond = (np.bincount(number, each[facet], len(pairs)) for each in (skin.left, skin.beyond_tip))
    is_both = (left > 0) & (left < counts) & (beyond == 0)
    both = patch[is_both[number]] if patches.cells.shape[1] == 3 else patch[:0]  # curves may cross themselves
    leaking[patches.table.find(patches.cells[both])] = True
    if leaking.any():
        at = place(lattice.to_scene(lattice.spacing * patches.table.cells[np.argmax(leaking)]))
        raise ResolutionError(
            f"at spacing={lattice.spacing:g} the sides of a boundary inside cannot be distinguished near {at}; use "
            "another spacing or origin, or form='collocation'."
        )


def _inside_samples(patches: SolidPatches, moments: Floats, spacing: float) -> Samples:
    """Return the samples inside: the Gauss points of the cells of all patches, by patch."""
    d, cells = patches.cells.shape[1], patches.cells
    cut, full = gauss_points(MOMENTS, d), gauss_points(FULL_POINTS, d)
    places = [cells[: patches.cut, None] + cut[0] - 0.5, cells[patches.cut :, None] + full[0] - 0.5]
    points = spacing * np.concatenate([each.reshape(-1, d) for each in places])
    weights = np.concatenate([gauss_weights(moments).ravel(), np.tile(full[1], len(cells) - patches.cut)])
    counts = np.where(np.arange(len(cells)) < patches.cut, len(cut[1]), len(full[1]))
    normals = np.zeros((len(points), 0, d))
    return Samples(points, spacing**d * weights, normals, np.repeat(np.arange(len(cells)), counts))


def _dof_map(patches: SolidPatches, patch: Ints, options: Options[GalerkinOptions]) -> DofMap:
    """Return the dof map of the patches; ``patch`` (q,) is that of each sample."""
    touching = distinct_pairs(patches.touching(), len(patches.cells))
    isolated = np.zeros(len(patches.cells), dtype=bool)
    return dof_map_from_patches(
        options.spacing, patches.cells, touching, np.ascontiguousarray(patch), isolated, options.own.degree
    )
