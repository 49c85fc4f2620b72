"""How well the lattice resolves a scene: folds, isolated pieces, layers, and reasons for slow convergence."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.forms.galerkin.coefficients import SampleCoefficients
from cpmkit.forms.galerkin.conditions.imposed_conditions import ImposedCondition, Tie
from cpmkit.forms.galerkin.dof_map import connected_pieces
from cpmkit.forms.galerkin.scene_sampling import SampledScene
from cpmkit.forms.galerkin.solution_warnings import FOLDED_SHARE, fold_warnings, resolution_warnings
from cpmkit.forms.galerkin.space.energy import load
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.quantised_samples import SAMPLES_AT_ONCE
from cpmkit.manifold.abilities import warnings_of
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.runtime.memory import state_without_cached
from cpmkit.scene.diffusivities import StateDiffusivity, evaluate_diffusivity, principal_diffusivities
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats

#: Lengths of the mean unit normal on the support of a spline: below the first the manifold is unresolved there (folded
#: or creased), below the second it is curved about as sharply as the spacing.
ALIGNED_LENGTH, BENDING_LENGTH = 0.6, 0.85
#: Folds persist if the unresolved share of the area exceeds the first number, and the second times the share at twice
#: the spacing. Parts thinner than both spacings cause the same errors in both solutions: on Nefertiti that quotient is
#: .5 to 1.9, and estimates without this rule are a quarter of the error; on Spot, koala and fish it is .1 to .4 from
#: the second solution on, and estimates are right.
PERSISTING_AREA, PERSISTING_SHARE = 0.005, 0.4
#: A layer narrower than this, in spacings, is not resolved: estimates were down to .3 of the error at a half, .66 at 1.
LAYER_SPACINGS = 0.9


@dataclass(frozen=True, eq=False)
class NormalSpread:
    """The share of the manifold on supports of splines where normals spread: limbs, creases, folds and thin edges."""

    unresolved_share: float  #: Share of the manifold's measure under unresolved splines.
    #: (d,): the node, relative to the lattice's origin, of the spline on whose support normals cancel most; or NaN.
    place: Floats
    #: Share where the manifold is curved about as sharply as the spacing, or is unresolved.
    bending_share: float


@dataclass(frozen=True, eq=False)
class LatticeResolution:
    """How the lattice resolves the manifold, whatever the equation."""

    sampled: SampledScene  #: The manifold and its boundaries.
    space: FunctionSpace  #: The splines.

    __getstate__ = state_without_cached

    @cached_property
    def normal_spread(self) -> NormalSpread:
        """The share of the manifold under splines N with |sum w N n| < .6 sum w N, n the normals at samples.

        On curves n are the tangents. The winding of the mesh orients them consistently over common facets of cells. On
        one-sided components this is impossible: splines near a facet where two cells disagree have NaN in place of the
        normal, and count as resolved.
        """
        space, mesh = self.space.splines, self.sampled.mesh
        if not space.samples.codim:  # solids have no normals
            return NormalSpread(0.0, np.full(space.dof_map.dim, np.nan), 0.0)
        samples, cells = space.samples, space.samples.cell
        signs = np.where(self.sampled.winding == 0, np.nan, self.sampled.winding)
        integrals, ends = np.zeros((space.dof_map.size, 1 + mesh.dim)), mesh.vertices[mesh.cells]
        for start in range(0, len(samples), SAMPLES_AT_ONCE):
            rows = slice(start, min(start + SAMPLES_AT_ONCE, len(samples)))
            some = cells[rows]
            across = samples.normals_at(rows)[:, 0] if mesh.manifold_dim == 2 else unit(ends[some, 1] - ends[some, 0])
            values = np.ones((len(some), 1 + mesh.dim))
            values[:, 1:] = across * signs[some, None]
            integrals += load(space, values, rows)
        area, length = integrals[:, 0], norms(integrals[:, 1:])
        is_unresolved = length < ALIGNED_LENGTH * area  # false where the normal is NaN
        bending = float(area[length < BENDING_LENGTH * area].sum() / area.sum())
        if not is_unresolved.any():
            return NormalSpread(0.0, np.full(space.dof_map.dim, np.nan), bending)
        heavy = np.flatnonzero(is_unresolved & (area >= np.median(area[is_unresolved])))
        worst = heavy[np.argmin(length[heavy] / area[heavy])]
        return NormalSpread(float(area[is_unresolved].sum() / area.sum()), space.dof_map.places[worst], bending)

    @cached_property
    def single_unknown_share(self) -> float:
        """The share of patches on pieces of the manifold that have one unknown each; 0 if there is one piece."""
        count, piece = connected_pieces(self.space.base_dof_map)
        size = np.bincount(piece, minlength=count)
        return float(np.mean(size[piece[self.space.base_dof_map.unknowns[:, 0]]] == 1)) if count > 1 else 0.0

    @cached_property
    def warnings(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Warnings on source, mesh and boundaries, and warnings on what the lattice does not resolve."""
        sampled, dof_map = self.sampled, self.space.base_dof_map
        lattice = sampled.lattice
        source = warnings_of(sampled.surface.source, lattice.spacing)
        rounding = lattice.rounding_warnings(sampled.surface.bounds, not sampled.surface.shift.any())
        boundary_patches = dof_map.patch[sampled.interior :]
        pieces = connected_pieces(dof_map)
        resolved = resolution_warnings(dof_map, pieces, lattice, boundary_patches, sampled.geometry)
        folds = fold_warnings(self.normal_spread, lattice)
        return (*source, *rounding, *sampled.warnings), (*resolved, *folds)


@dataclass(frozen=True, eq=False)
class Resolution:
    """How the lattice resolves the manifold and the layers of an equation."""

    scene: Scene  #: The scene with the equation.
    conditions: tuple[ImposedCondition, ...]  #: The conditions of the scene.
    coefficients: SampleCoefficients  #: Evaluates coefficients at the samples.
    of_manifold: LatticeResolution  #: The part that does not depend on the equation.

    __getstate__ = state_without_cached

    @property
    def spacing(self) -> float:
        """Spacing h of the lattice."""
        return self.coefficients.space.spacing

    @property
    def normal_spread(self) -> NormalSpread:
        """The share of the manifold that is thin, folded or creased on this lattice."""
        return self.of_manifold.normal_spread

    @cached_property
    def layer_spacings(self) -> float:
        """The width of the thinnest layer of the solution in spacings; infinite where there are no layers.

        Steady problems -div(a grad u) + c u = f have layers of width sqrt(a / c), with the least a and the largest c,
        along boundaries and rims with conditions (rims with zero flux alone have none). With a tensor a they may be
        anywhere: a is then its smallest eigenvalue in the tangent space, and the width is at most half the extent of
        the manifold times sqrt(smallest / largest eigenvalue). Infinite for other problems and where a depends on u.
        """
        terms = self.scene.problem.terms()
        if self.scene.problem.family != "steady" or isinstance(terms.diffusivity, StateDiffusivity):
            return np.inf
        c = float(self.coefficients.at_points(terms.c, "the factor c").max())
        if self.scene.has_tensor:
            return self._tensor_layer_width(c) / self.spacing
        if c <= 0 or all(isinstance(condition.law, Tie) for condition in self.conditions):
            return np.inf
        a = float(self.coefficients.at_points(terms.diffusivity, "the diffusivity").min())
        return float(np.sqrt(a / c) / self.spacing)

    def _tensor_layer_width(self, c: float) -> float:
        """Return the width of the thinnest layer, in the scene's unit, for a tensor and the largest factor ``c``."""
        points = self.coefficients.points
        tensors = evaluate_diffusivity(self.scene.problem.terms().diffusivity, points, "the diffusivity")
        normals = self.coefficients.sampled.samples.normals_at(slice(self.coefficients.sampled.interior))
        least, largest = principal_diffusivities(tensors, normals)
        radius = 0.5 * float(np.ptp(np.asarray(self.scene.surface.bounds), axis=0).max())
        least = np.maximum(least, 0.0)  # a tensor with a negative eigenvalue is refused by the assembly
        width = radius * np.sqrt((least / largest).min())
        return float(width if c <= 0 else min(width, np.sqrt(least.min() / c)))

    def tensor_layer_warnings(self) -> tuple[str, ...]:
        """Return a warning if the smallest eigenvalue of a tensor makes layers that the spacing does not resolve."""
        if self.scene.problem.family != "steady" or not self.scene.has_tensor or self.layer_spacings >= LAYER_SPACINGS:
            return ()
        return (
            "The diffusivity conducts so badly along one direction that the solution may have layers "
            f"{self.layer_spacings:.2g} spacings wide, which are not resolved; a spacing of "
            f"{self.spacing * self.layer_spacings / LAYER_SPACINGS:.2g} or less resolves them.",
        )

    def end_or_layer_reason(self) -> str:
        """Return in words that a boundary ends inside without singular functions, or a layer is unresolved; else ""."""
        if self.coefficients.sampled.has_tips and not self.coefficients.sampled.singular:
            return "boundaries end inside the manifold; the error may fall slowly"
        if self.layer_spacings < LAYER_SPACINGS:
            where = "along the direction that conducts worst" if self.scene.has_tensor else "beside conditions"
            return f"a layer {where} is {self.layer_spacings:.2g} spacings wide; the error may fall slowly"
        return ""

    def slow_convergence_reason(self, coarser: Resolution | None = None) -> str:
        """Return in words why the error may fall slowly with the spacing; empty without a reason.

        With a ``coarser`` lattice, folds that are about as large on both lattices are a reason too.
        """
        reason, share = self.end_or_layer_reason(), self.normal_spread.unresolved_share
        if reason:
            return reason
        if len(self.coefficients.sampled.mixed_edge):
            return "a value and a flux are prescribed side by side at the edge; the error may fall slowly"
        if part := self.coefficients.sampled.slow_part_of_solid:
            return f"{part}; the error may fall slowly"
        if share > FOLDED_SHARE:
            return f"thin, folded or creased: {share:.0%} of the area; the error may fall slowly"
        if coarser is not None and self.folds_persist(coarser):
            same = f"about as much at spacing {coarser.spacing:.3g}"
            return f"thin, folded or creased: {share:.1%} of the area, {same}; the error may fall slowly"
        return ""

    def folds_persist(self, coarser: Resolution) -> bool:
        """Return whether the unresolved share exceeds .005, and .4 times that of ``coarser`` per halving of spacing."""
        share = self.normal_spread.unresolved_share
        halvings = np.log2(coarser.spacing / self.spacing)
        return bool(
            share > PERSISTING_AREA and share > PERSISTING_SHARE**halvings * coarser.normal_spread.unresolved_share
        )
