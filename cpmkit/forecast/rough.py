"""A first guess of what a solve will build, from cells or coarser blocks around the manifold and its boundaries.

Nothing is laid out, cut or sampled. How far off the guess is was measured on ten scenes: see :data:`OFF_BY`.
"""

from __future__ import annotations

from cpmkit.forecast.needs import solver_for
from cpmkit.forecast.parts import Explanation, Part, named, solver_part
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.galerkin import galerkin_cost as galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.options import Options
from cpmkit.grid.band import cell_levels, check_numbered, nodes_of_blocks, stencil_codes
from cpmkit.grid.fitting import check_fits
from cpmkit.grid.lattice import COARSEST_BAND_SHARE, COARSEST_SPACING_SHARE, Codes, lattice_of
from cpmkit.grid.stencils import base_offset
from cpmkit.manifold.abilities import advice_of, integral_floor_of
from cpmkit.manifold.local_source import LocalSource, largest_dim, localize
from cpmkit.protocols import ClosestPointSource
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Unknowns and bytes are within this factor of the truth.
OFF_BY = 2.0
#: Up to so many cells unknowns are counted; of finer lattices they are guessed from as many blocks of cells.
GUESSED_BLOCKS = 3_000
#: Unknowns of a boundary, over those of a band around it alone: each side has those whose stencils meet the curve.
COLLOCATION_SIDES, GALERKIN_SIDES = 2.0, 1.0


def guessed(scene: Scene, target: Options[CollocationOptions] | Options[GalerkinOptions], solver: str) -> Explanation:
    """Say about what a form will build.

    Raises
    ------
    ResolutionError
        If there is not the memory for it.
    """
    by_galerkin = isinstance(target.own, GalerkinOptions)
    coarsest = COARSEST_SPACING_SHARE if by_galerkin else COARSEST_BAND_SHARE
    origin = lattice_of(scene.surface, target.spacing, target.origin, coarsest).origin
    surface = localize(scene.surface, origin)
    check_numbered(surface.bounds, target.spacing)
    of_surface = _unknowns(surface, target)
    sides = GALERKIN_SIDES if by_galerkin else COLLOCATION_SIDES
    of_boundaries = [sides * _unknowns(localize(one.source, origin), target) for one in scene.boundaries]
    unknowns = of_surface + sum(of_boundaries)
    chosen = solver_for(scene, target, solver, unknowns)
    parts = [Part("unknowns of the surface", _about(of_surface), f"form {target.form!r}: {target.reason}")]
    for boundary, count in zip(scene.boundaries, of_boundaries, strict=True):
        left, right = boundary.condition("left"), boundary.condition("right")
        laws = named(left) if left is right else f"{named(left)} left, {named(right)} right"
        parts.append(Part(f"unknowns at {boundary.name!r}", _about(count), f"each side has its own: {laws}"))
    parts.append(solver_part(scene, chosen, solver))
    return Explanation(
        parts=tuple(parts),
        left_out=(),
        unknowns=round(unknowns),
        closest_point_queries=None,
        bytes=round(_bytes(scene, surface, target, chosen, unknowns)),
        floor=(integral_floor_of if by_galerkin else _floor)(scene.surface, target.spacing),
        solver=chosen,
        exact=False,
        off_by=OFF_BY,
    )


def _floor(surface: ClosestPointSource, spacing: float) -> float:
    return advice_of(surface, spacing).floor


def _about(count: float) -> str:
    return f"about {float(f'{count:.1g}' if count < 10 else f'{count:.2g}'):,.0f}"


def _unknowns(source: LocalSource, target: Options[CollocationOptions] | Options[GalerkinOptions]) -> float:
    """Return about how many unknowns a band around a source has; those at a point are too few to count."""
    if source.largest_dim == 0:
        return 0.0
    degree, spacing = target.own.degree, target.spacing
    levels = cell_levels(source, spacing, base_offset(degree))
    side, blocks = next((side, blocks) for side, blocks in levels if side == 1 or len(blocks) > GUESSED_BLOCKS)
    if side > 1:
        return nodes_of_blocks(len(blocks), side, source.dim, source.largest_dim, degree)
    return float(len(stencil_codes(blocks, Codes.around(blocks, degree + 1), degree)))


def _bytes(
    scene: Scene,
    surface: LocalSource,
    target: Options[CollocationOptions] | Options[GalerkinOptions],
    chosen: str,
    unknowns: float,
) -> float:
    """Return the bytes at the peak, if there are so many."""
    degree = target.own.degree
    if isinstance(target.own, GalerkinOptions):
        factors = galerkin.factorised_share(scene, chosen)
        galerkin.check_unknowns_fit(surface, unknowns, target.spacing, chosen, factors, degree)
        return galerkin.peak_bytes(
            unknowns, largest_dim(scene.surface), factors, degree=degree, beside=galerkin.scene_extras(scene)
        )
    check_fits(surface, unknowns, target.spacing, degree, chosen)
    rows = memory.rows_per_unknown(surface.dim) * unknowns
    return memory.peak_bytes(rows, unknowns, surface.dim, degree, scene.channels, chosen)
