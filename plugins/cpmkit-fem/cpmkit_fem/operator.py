"""The operator A of finite elements: unknowns are all nodes, and pinned ones have a row of their own.

With f the free vertices, p the pinned ones and g their values, ``A = [K_ff 0; 0 D]`` and ``b = [b_f - K_fp g; D g]``,
D the diagonal of K: A is symmetric where K is, and its solution has u = g at pinned vertices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import CsrOperator, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False, kw_only=True)
class VertexOperator(CsrOperator):
    """The matrix A of a scene, with the matrices by which the conditions' data enter the right-hand side.

    Attributes
    ----------
    matrix : csr_array (v, v)
        A.
    coupling : csr_array (v, p)
        The matrix that multiplies the p prescribed values and is subtracted from b: K_fp, and -D at the vertex itself.
    rims : sequence of csr_array (v, e c)
        For each part of the rim, the integrals of a u v divided by the law's alpha, v a function of one facet alone.
    fixed : bool
        Whether c alone surely fixes the solution.
    diffusivity : (v,) float64
        The diffusivity at the vertices.
    """

    coupling: csr_array
    rims: Sequence[csr_array]
    fixed: bool
    diffusivity: Floats


def pinned_operator(
    matrix: csr_array, pins: Ints, rims: Sequence[csr_array], fixed: bool, diffusivity: Floats
) -> VertexOperator:
    """Return A: the symmetric ``matrix`` K (v, v) with rows and columns of ``pins`` (p,) replaced by D, abs(diag K).

    ``rims``, ``fixed`` and ``diffusivity`` are stored as :class:`VertexOperator` describes.
    """
    diagonal = np.zeros(len(matrix.indptr) - 1)
    diagonal[pins] = np.abs(matrix.diagonal()[pins])
    rows = diagonal_matrix(diagonal)
    made = zero_pinned_rows(matrix, pins, columns=True) + rows
    coupling = zero_pinned_rows(matrix, pins, columns=False)[:, pins] - rows[:, pins]
    return VertexOperator(
        made.tocsr(), True, coupling=coupling.tocsr(), rims=rims, fixed=fixed, diffusivity=diffusivity
    )


def zero_pinned_rows(matrix: csr_array, pins: Ints, columns: bool) -> csr_array:
    """Return the matrix (v, v) with zero rows at ``pins`` (p,), and zero columns there too if ``columns``."""
    free = np.ones(matrix.shape[0])
    free[pins] = 0.0
    kept = diagonal_matrix(free)
    made: csr_array = (kept @ matrix @ kept if columns else kept @ matrix).tocsr()
    made.eliminate_zeros()
    return made


def diagonal_matrix(diagonal: Floats) -> csr_array:
    """Return the sparse matrix (v, v) with the given ``diagonal`` (v,), without stored zeros."""
    from scipy.sparse import diags_array

    made: csr_array = diags_array(diagonal).tocsr()
    made.eliminate_zeros()
    return made
