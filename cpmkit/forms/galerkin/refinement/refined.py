"""The Galerkin form on splines of several levels: its unknowns are the coefficients of the active ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.form_records import ExpectedError
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.galerkin_operator import levels_resolving_waves
from cpmkit.forms.galerkin.levels import coarser_levels
from cpmkit.forms.galerkin.patch_locator import PatchLocator
from cpmkit.forms.galerkin.projection import Projection
from cpmkit.forms.galerkin.quadrature.samples import SAMPLES_AT_ONCE
from cpmkit.forms.galerkin.refinement.hierarchical_splines import prolongation_to, representations
from cpmkit.forms.galerkin.refinement.refined_space import RefinedDofMap, RefinedSpace
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.galerkin.shared import cached_on_space
from cpmkit.forms.galerkin.space.dof_map import DofMap
from cpmkit.forms.galerkin.space.energy import (
    Stabilisation,
    add_floor,
    add_ghosts,
    conductivity,
    energy_data,
    gradients_at,
    load,
    mass,
    values_at_samples,
)
from cpmkit.forms.galerkin.space.splines import derivative_rows, value_rows
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import CsrOperator
from cpmkit.linear.protocols import Operator
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class RefinedLocator(PatchLocator):
    """Finds the patches of points among those of several levels."""

    def _patch_of_cell(self, points: Floats, found: Ints, apart: Floats, patch: Ints) -> Ints:
        assert isinstance(self.dof_map, RefinedDofMap)
        own = self.dof_map.magnified(found, points[:, None]) / self.lattice.spacing + 0.5
        fits = (self.dof_map.cells[found] == np.floor(own)).all(axis=2) & np.isfinite(apart)
        best = np.where(fits, apart, np.inf).argmin(axis=1)
        rows = np.arange(len(points))
        return np.where(fits[rows, best], found[rows, best], patch)


@dataclass(frozen=True, eq=False)
class RefinedGalerkin(Galerkin):
    """A scene on truncated hierarchical splines.

    What others of the form's matrices are over the magnified levels, ``R' A R`` is over the active splines.

    Attributes
    ----------
    refined : RefinedSpace
        The splines; ``space`` are the magnified levels.
    regions : Regions
        Where the levels are.
    passes : int
        How often the scene was solved to find them.
    gain : float
        By how many times fewer unknowns the first of these let expect for one error.
    """

    refined: RefinedSpace
    regions: Regions
    passes: int = 0
    gain: float = 0.0

    # Splines

    @cached_on_space
    def representation(self) -> csr_array:
        """R (N, n), the active splines in terms of those of all levels."""
        return self.refined.stacked(representations(self.refined.levels, self.regions.finest))

    @property
    def finest_spacing(self) -> float:
        """That of the finest level."""
        return float(self.spacing / 2**self.regions.finest)

    @property
    def size(self) -> int:
        """Number of active splines."""
        return int(self.representation.shape[1])

    def _spread(self, u: Floats) -> Floats:
        return np.asarray(self.representation @ u)

    def _gathered(self, matrix: csr_array) -> csr_array:
        """Return R' A R, symmetric to the last bit if A is."""
        product = (self.representation.T @ (matrix @ self.representation)).tocsr()
        return ((product + product.T) * 0.5).tocsr()

    @property
    def _sample_scales(self) -> Floats:
        """(q,) by how much the patch of each sample is magnified."""
        return self.refined.dof_map.scales(self.refined.dof_map.patch)

    def _value_rows(self, patch: Ints, points: Floats) -> csr_array:
        dof_map = self.refined.dof_map
        return (value_rows(dof_map, patch, dof_map.magnified(patch, points)) @ self.representation).tocsr()

    def _derivative_rows(self, patch: Ints, points: Floats, directions: Floats) -> csr_array:
        dof_map = self.refined.dof_map
        along = directions * dof_map.scales(patch)[:, None]
        rows = derivative_rows(dof_map, patch, dof_map.magnified(patch, points), along)
        return (rows @ self.representation).tocsr()

    @cached_on_space
    def _locator(self) -> PatchLocator:
        plain = super()._locator
        return RefinedLocator(plain.lattice, plain.samples, plain.dof_map, plain.sides, plain.boundaries, plain.sheets)

    # Sums over samples

    def _loads(self, values: Floats) -> Floats:
        return np.asarray(self.representation.T @ load(self.space, values))

    @cached_on_space
    def _areas(self) -> Floats:
        return np.asarray(self.representation.T @ self._areas_and_turned[0])

    def gradient_load(self, values: Floats) -> Floats:
        """Refuse: what weak divergences are taken of is not known beyond the spacing that it was made at."""
        raise SceneError("refine='auto' takes no divergence as a right-hand side; use refine='off'.")

    def _spline_values(self, u: Floats, rows: slice | Ints) -> Floats:
        return values_at_samples(self.space, self._spread(u), rows)

    def _spline_slopes(self, u: Floats) -> Floats:
        dof_map, spread = self.refined.dof_map, self._spread(u)
        slopes = np.empty((self.sampled.interior, u.shape[1], dof_map.dim))
        for start in range(0, len(slopes), SAMPLES_AT_ONCE):
            some = slice(start, min(start + SAMPLES_AT_ONCE, len(slopes)))
            patch, samples = dof_map.patch[some], self.sampled.samples
            at = dof_map.magnified(patch, samples.points_at(some))
            found = gradients_at(self.space, patch, at, samples.normals_at(some), spread)
            slopes[some] = found * dof_map.scales(patch)[:, None, None]
        return slopes

    @cached_on_space
    def _mass(self) -> CsrOperator:
        return CsrOperator(self._gathered(mass(self.space, 1.0)), symmetric=True)

    @cached_on_space
    def _projection(self) -> Projection:
        ones, none = np.ones(1), Stabilisation(0.0, 0.0, 0.0)
        held = self._energy(ones, None, self._strength, -2) - self._energy(ones, None, none, -2)
        return Projection((self.mass.matrix + self.spacing**2 * self._gathered(held)).tocsr())

    def _floored_stiffness(self, a: Floats, c: Floats | None, holding: Floats | None) -> csr_array:
        assert holding is None
        return self._gathered(self._energy(a, c, self._strength, 0, floored=True))

    def _energy(
        self, a: Floats, c: Floats | None, strength: Stabilisation, power: int, floored: bool = False
    ) -> csr_array:
        """Return the energy (N, N) over the magnified levels, with S, times the magnification to a ``power``.

        There lengths are larger and slopes smaller by the magnification, while weights are what they are: the
        coefficient makes up for both. On surfaces the squares of differences and the floor have no unit.
        """
        scales = self._sample_scales ** float(power)
        m = self.space.manifold_dim
        squares = (scales * self._sample_scales**2).reshape(-1, *(1,) * (a.ndim - 1))
        held = scales * self._sample_scales ** (2 - m) * conductivity(self.space, a)
        data = energy_data(self.space, a * squares, c, strength)
        if not floored:
            add_ghosts(self.space, held, strength, data)
            return self.space.matrix(data)
        diagonal = self.space.matrix(data).diagonal()
        add_ghosts(self.space, held, strength, data)
        add_floor(self.space, held, diagonal, data)
        return self.space.matrix(data)

    @property
    def _boundary_spacings(self) -> Floats:
        return self.spacing / self._sample_scales[self.sampled.interior :]

    # Levels

    def levels(self, operator: Operator) -> Sequence[Level]:
        """Return the spaces capped at each level, and the coarser lattices below level 0."""
        capped, below = self._levels_of_both
        return [*capped, *levels_resolving_waves(below, operator, self.spacing)]

    @cached_on_space
    def _levels_of_both(self) -> tuple[list[Level], list[Level]]:
        levels, cap = self.refined.levels, self.regions.finest
        rows = np.arange(self.sampled.interior, len(self.sampled.samples))
        on = self.regions.levels(self.sampled.boundary.points)
        found = []
        for finest in range(cap, 0, -1):
            own, coarser = representations(levels, finest), representations(levels, finest - 1)
            read = [
                own[level][np.unique(levels[level].dof_map.unknowns[levels[level].patch_of(rows[here])])].indices
                for level in range(finest + 1)
                if len(here := np.flatnonzero(np.minimum(on, finest) == level))
            ]
            strip = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *read])).astype(np.int64)
            found.append(Level(prolongation_to(levels, finest, coarser[-1]), strip))
        first = levels[0].dof_map
        return found, coarser_levels(first, first.patch[self.sampled.interior :])

    # Telling

    def estimate(self, u: Floats) -> ExpectedError | None:
        """Return nothing: coefficients of several levels stand beside each other."""
        del u
        return None

    @property
    def _first_dof_map(self) -> DofMap:
        """The parting of level 0, by which pieces and copies are told."""
        return self.refined.levels[0].dof_map

    @property
    def told_refinement(self) -> str:
        """Whether the splines were refined, and why, in words."""
        expected = f"sizes that differ let expect {self.gain:.2g} times fewer unknowns for one error"
        if not self.regions.finest:
            return f"off: {expected}"
        sizes = ", ".join(f"{size:,}" for size in self.level_sizes)
        return f"on: {expected}; {sizes} unknowns on levels 0 to {self.regions.finest}"

    @property
    def level_sizes(self) -> tuple[int, ...]:
        """How many active splines each level has."""
        return tuple(int(level.active.sum()) for level in self.refined.levels)

    def describe(self) -> dict[str, Any]:
        """Return the form's options, the lattice's origin, and what was refined."""
        sizes = list(self.level_sizes)
        return {
            **super().describe(),
            "refined_levels": sizes,
            "refinement_passes": self.passes,
            "refinement": self.told_refinement,
        }

    def arrays(self) -> dict[str, Any]:
        """Return what the form's are, with the cells that are parted."""
        return {**super().arrays(), "parted_cells": self.regions.table()}

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Compare the nodes of level 0, where the left of boundaries is, and the cells that are parted."""
        found = super().differs_from(saved)
        if found:
            return found
        same = np.array_equal(self.regions.table(), saved.get("parted_cells", ()))
        return "" if same else "it was refined elsewhere"
