"""Splines and singular functions together: u = sum_j c_j N_j + sum_k s_k psi_k, the s_k behind the c_j.

What holds u where no sample sees it (normal derivatives, differences) is of splines: psi is constant along normals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.forms.galerkin.space.splines import derivative_rows, value_rows
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Enrichment:
    """Singular functions beside a space of splines; where there are none, all stays as it is given.

    Attributes
    ----------
    functions : sequence of SingularFunction
        The m functions psi_k.
    space : Space
        The n splines N_j, over the samples of the manifold and those on boundaries after them.
    interior : int
        Number of the former.
    """

    functions: Sequence[SingularFunction]
    space: SplineSpace
    interior: int

    @property
    def splines(self) -> int:
        """Number n of splines."""
        return self.space.dof_map.size

    def __len__(self) -> int:
        return len(self.functions)

    # Reading

    def values(self, points: Floats, cells: Ints) -> csr_array:
        """Return (q, m) the psi_k at points (q, d) in these cells of the mesh (q,)."""
        return self._columns([one.values(points, cells) for one in self.functions], len(points))

    def slopes(self, points: Floats, cells: Ints, directions: Floats) -> csr_array:
        """Return (q, m) their derivatives along ``directions`` (q, d)."""
        found = [one.slopes(points, cells) for one in self.functions]
        along = [(rows, np.einsum("kd,kd->k", slopes, directions[rows])) for rows, slopes in found]
        return self._columns(along, len(points))

    def gradients(self, points: Floats, cells: Ints) -> list[csr_array]:
        """Return the d matrices (q, m) that read them along the axes."""
        axes = np.eye(self.space.dof_map.dim)
        return [self.slopes(points, cells, np.broadcast_to(axis, points.shape)) for axis in axes]

    @property
    def inside(self) -> csr_array:
        """(q, m) the psi_k at the samples of the manifold."""
        return self._columns([(rows, psi) for rows, psi, _ in self._at_samples], self.interior)

    @cached_property
    def _at_samples(self) -> list[tuple[Ints, Floats, Floats]]:
        """The samples (k,) in the disc of each function, its values (k,) and tangential gradients (k, d) there."""
        samples, count = self.space.samples, self.interior
        points, normals, cells = samples.points[:count], samples.normals[:count], samples.cell[:count]
        found = []
        for one in self.functions:
            rows, psi = one.values(points, cells)
            slopes = one.slopes(points, cells)[1]
            along = np.einsum("kcd,kd->kc", normals[rows], slopes)
            found.append((rows, psi, slopes - np.einsum("kcd,kc->kd", normals[rows], along)))
        return found

    def _columns(self, found: Sequence[tuple[Ints, Floats]], count: int) -> csr_array:
        from scipy.sparse import csc_array

        starts = np.cumsum([0, *(len(rows) for rows, _ in found)])
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(rows for rows, _ in found)])
        entries = np.concatenate([np.zeros(0), *(entries for _, entries in found)])
        return csc_array((entries, rows, starts), shape=(count, len(found))).tocsr()

    # Equations

    def bordered(self, matrix: csr_array, a: Floats | None, c: Floats | None) -> csr_array:
        """Return the splines' ``matrix`` (n, n) bordered by integrals of a grad u . grad v + c u v with the psi_k.

        ``a`` and ``c``: (q,) at all samples, (1,) for all of them; None where the term is missing.
        """
        from scipy.sparse import block_array

        if not len(self):
            return matrix
        cross, own = np.zeros((self.splines, len(self))), np.zeros((len(self), len(self)))
        dof_map, samples = self.space.dof_map, self.space.samples
        weighted = [None if one is None else samples.weights * one for one in (a, c)]
        for k, (rows, psi, slopes) in enumerate(self._at_samples):
            at = dof_map, dof_map.patch[rows], samples.points[rows]
            if weighted[0] is not None:
                cross[:, k] += derivative_rows(*at, slopes).T @ weighted[0][rows]
            if weighted[1] is not None:
                cross[:, k] += value_rows(*at).T @ (weighted[1][rows] * psi)
        for weights, read in zip(weighted, (self.slopes_inside, [self.inside]), strict=True):
            if weights is not None:
                own += sum((one.T @ (one * weights[: self.interior, None])).toarray() for one in read)
        return block_array([[matrix, cross], [cross.T, own]], format="csr")

    @property
    def slopes_inside(self) -> list[csr_array]:
        """The d matrices (q, m) that read their tangential gradients at the samples of the manifold."""
        dim = self.space.dof_map.dim
        return [
            self._columns([(rows, slopes[:, axis]) for rows, _, slopes in self._at_samples], self.interior)
            for axis in range(dim)
        ]

    def with_loads(self, loads: Floats, values: Floats) -> Floats:
        """Return the ``loads`` (n, k) of splines, and below them the integrals of ``values`` times the psi_k.

        ``values``: (q, k) at the samples of the manifold, (1, k) for all of them.
        """
        if not len(self):
            return loads
        weighted = self.space.samples.weights[: self.interior, None] * values
        return np.concatenate([loads, self.inside.T @ weighted])

    def read_by(self, terms: ConditionTerms) -> ConditionTerms:
        """Return conditions on splines as conditions on both."""
        from scipy.sparse import hstack

        if not len(self):
            return terms
        at, cells = terms.samples.points, terms.samples.cell
        values = hstack([terms.values, self.values(at, cells)], format="csr")
        slopes = hstack([terms.slopes, self.slopes(at, cells, terms.samples.conormals)], format="csr")
        return replace(terms, values=values, slopes=slopes)

    def on_levels(self, levels: Sequence[Level]) -> list[Level]:
        """Return levels on which the s_k stay as they are, solved for with the strip."""
        from scipy.sparse import block_diag, eye_array

        if not len(self):
            return list(levels)
        own, found = np.arange(len(self)), []
        for level in levels:
            prolongation = block_diag([level.prolongation, eye_array(len(self))], format="csr")
            strip = np.concatenate([level.strip, level.prolongation.shape[0] + own])
            found.append(Level(prolongation, strip, lines=level.lines))
        return found
