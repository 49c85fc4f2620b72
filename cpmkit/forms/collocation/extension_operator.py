"""The operator A = c I - M of the collocation form, M = diag(L) + (L - diag L) E, from the tables and an equation.

King et al. (2024), eq. 3 and section 5.3; in its section 5.4, a screened problem needs n = -1, not 1.

L is the second order cross Laplacian, or its generalisation to a variable diffusivity and a velocity:
``A u = diagonal u - W (E u + g)`` with the weights W of the difference neighbours and the boundary data g. The ghosts'
rows are rows of the PDE like those of nodes (Krylov methods stagnate on purely algebraic ghost rows).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.errors import InputError, ResolutionError, SceneError
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.ghosts.ghosts import Ghosts
from cpmkit.forms.collocation.row_formula import RowFormula
from cpmkit.grid.band import cross_offsets
from cpmkit.linear.csr_matrices import UnsignedCsr
from cpmkit.linear.operators import Operator, connected_unknowns
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.equations import Terms, VectorField
from cpmkit.types import Floats, Ints, SparseMatrix

#: Central differences oscillate if the ratio of advection over one spacing to diffusion is larger than this.
MOST_CELL_PECLET = 2.0


@dataclass(frozen=True, eq=False)
class ExtensionOperator:
    """The operator ``A u = diagonal u - scale W E u``, with E and W stored separately."""

    extension: SparseMatrix  #: (rows, n): the extension matrix E.
    differences: SparseMatrix  #: (n, rows): W, the weights of the difference neighbours.
    diagonal: float | Floats  #: float or (n, 1) float64: the diagonal of c I - diag(L).
    scale: float  #: Factor of W, often ``1 / spacing^2``.

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return int(self.extension.shape[1])

    @property
    def nonzeros(self) -> int:
        """The number of entries stored in E and W."""
        return int(self.extension.nnz + self.differences.nnz)

    @property
    def symmetric(self) -> bool:
        """False: if node i is in the stencil of node j, node j need not be in the stencil of node i."""
        return False

    def apply(self, u: Floats) -> Floats:
        """Return A u for u (n,) or (n, channels)."""
        columns = np.ascontiguousarray(u.reshape(len(u), -1))
        product = self._differences.apply(self._extension.apply(columns))
        return np.asarray(self.diagonal * columns - self.scale * product).reshape(u.shape)

    def apply_rows(self, u: Floats, rows: Ints) -> Floats:
        """Return the entries ``rows`` (r,) of A u, u (n,) or (n, channels), from only the entries of E u they need."""
        read = self.differences[rows]
        columns = np.unique(read.indices)
        product = read[:, columns] @ (self.extension[columns] @ u)
        diagonal = np.broadcast_to(np.ravel(self.diagonal), self.size)[rows].reshape(-1, *(1,) * (u.ndim - 1))
        return np.asarray(diagonal * u[rows] - self.scale * product)

    @cached_property
    def _extension(self) -> UnsignedCsr:
        return UnsignedCsr.from_matrix(self.extension)

    @cached_property
    def _differences(self) -> UnsignedCsr:
        return UnsignedCsr.from_matrix(self.differences)

    def datum_load(self, datum: Floats) -> Floats:
        """Return ``scale W datum`` (n, channels), the right-hand side of a datum (rows, channels) added to E u."""
        return np.asarray(self.scale * (self.differences @ datum))

    def to_csr(self) -> SparseMatrix:
        """Return A as one sparse matrix (n, n)."""
        from scipy.sparse import diags_array

        diagonal = np.broadcast_to(np.ravel(self.diagonal), self.size)
        matrix: SparseMatrix = (diags_array(diagonal) - (self.differences @ self.extension) * self.scale).tocsr()
        return matrix

    def pieces(self) -> tuple[int, Ints]:
        """Return the number of connected components of A's graph, and the number (n,) of each unknown's component."""
        count, n = sum(self.differences.shape), self.size
        _, label = connected_unknowns(count, [(self.differences, 0, n), (self.extension, n, 0)])
        return int(label[:n].max(initial=-1)) + 1, label[:n]

    def scaled_plus_mass(self, factor: float, mass: Operator | None = None) -> ExtensionOperator:
        """Return the operator ``I + factor A``; ``mass`` must be None, as the mass matrix is the identity."""
        assert mass is None
        return replace(self, diagonal=1.0 + factor * self.diagonal, scale=factor * self.scale)

    def minus_shifted_mass(self, shift: float, mass: BoundaryMass | None = None) -> ExtensionOperator:
        """Return ``A - shift M``; M is the boundary mass ``mass`` of Steklov conditions, or the identity if None."""
        if mass is None:
            return replace(self, diagonal=self.diagonal - shift)
        return replace(self, extension=(self.extension + shift * mass.reads).tocsr())


@dataclass(frozen=True, eq=False)
class BoundaryMass:
    """The boundary mass ``B = scale W S`` of the eigenproblem ``A u = lambda B u`` with du/db = lambda u at boundaries.

    With ``u(ghost) = u(mirror) + s lambda u(y)``, y the closest point on the boundary, ``E u`` becomes
    ``E u + lambda S u``.
    """

    operator: ExtensionOperator  #: A, whose W and scale are used.
    reads: SparseMatrix  #: (rows, n): S, which interpolates u at y and multiplies by the ghost's factor s.

    @cached_property
    def matrix(self) -> SparseMatrix:
        """B as one sparse matrix (n, n)."""
        matrix: SparseMatrix = (self.operator.scale * (self.operator.differences @ self.reads)).tocsr()
        return matrix

    def apply(self, u: Floats) -> Floats:
        """Return B u for u (n,) or (n, channels)."""
        return np.asarray(self.matrix @ u)


def build_operator(tables: Discretization, terms: Terms) -> ExtensionOperator:
    """Return the operator A of the terms c u - div(a grad u), and of v . grad u if there is a velocity v.

    ``terms.conservative`` is ignored: :func:`check_terms` refuses it. Raises InputError if c or a is no number or
    callable of points, a callable a is not positive, or v has not d coordinates. Raises ResolutionError if the spacing
    is too coarse for the velocity.
    """
    layout = tables.layout
    scale = 1.0 / layout.lattice.spacing**2
    c = _scalar_coefficient(tables, terms.c, "the factor c")
    if not callable(terms.diffusivity) and terms.velocity is None:
        a = float(_scalar_coefficient(tables, terms.diffusivity, "the diffusivity")[0, 0])
        diagonal = c + 2 * layout.lattice.dim * a * scale
        constant = not callable(terms.c)
        return ExtensionOperator(
            tables.extension, tables.differences, float(diagonal[0, 0]) if constant else diagonal, a * scale
        )
    at_rows = _extrapolated_diffusivity(tables, terms.diffusivity)
    # The weights (n, 2 d) of the neighbours in spacing^2 div(a grad u): a at the midpoints.
    weights = 0.5 * (at_rows[tables.unknowns.row_of_unknown][:, None] + at_rows[tables.neighbours])
    diagonal = c + scale * weights.sum(axis=1, keepdims=True)
    if terms.velocity is not None:
        weights = weights - _advection_weights(tables, terms.velocity, weights)
    return ExtensionOperator(tables.extension, tables.weighted_differences(weights), diagonal, scale)


def check_terms(terms: Terms) -> None:
    """Raise SceneError, with alternatives, for a conservative velocity, ``div(v u)``, and for a capacity."""
    if callable(terms.capacity) or terms.capacity != 1:
        raise SceneError(
            "the form 'collocation' has u_t without a capacity; divide the other terms by it, or use form='galerkin'."
        )
    if terms.conservative:
        raise SceneError(
            "the form 'collocation' has v . grad u, not div(v u); leave `conservative` out and add div v to c, or use "
            "form='galerkin'."
        )


def _scalar_coefficient(tables: Discretization, data: Data, label: str) -> Floats:
    """Return a coefficient (n, 1) of the equation at the unknowns; InputError, with ``label``, if it is not scalar."""
    if not callable(data):
        return np.full((tables.unknowns.count, 1), evaluate_data(data, np.zeros((1, 1)), 1, label)[0, 0])
    return tables.read_at_rows(data, label)[tables.unknowns.row_of_unknown]


def _extrapolated_diffusivity(tables: Discretization, data: Data) -> Floats:
    """Return the diffusivity a (rows,) at all rows of E, extrapolated across boundaries and past edges.

    A diffusivity continued as a constant would be wrong by O(spacing) where the flux is not zero, and so would be the
    solution near Neumann and Robin conditions (measured on a circle: order 1.0). The logarithm is extrapolated, so that
    a stays positive. Raises InputError if a is not positive where it is read.
    """
    layout = tables.layout

    def log_at(points: Floats) -> Floats:
        """Return log a (k,) at points (k, d) relative to the lattice's origin; raise InputError if a <= 0."""
        a = evaluate_data(data, layout.lattice.to_scene(points), 1, "the diffusivity")[:, 0]
        if np.any(a <= 0):
            raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
        return np.asarray(np.log(a))

    formula, sources = layout.formula, layout.sources
    at_sources, mirror = log_at(sources.points), log_at(formula.points)
    log = np.where(sources.coefficient == 1, 2 * at_sources - mirror, sources.coefficient * at_sources)
    return np.concatenate(
        [np.exp(_add_log_terms(log, sources, log_at)), *(_ghost_diffusivity(g, log_at) for g in layout.ghosts)]
    )


def _ghost_diffusivity(ghosts: Ghosts, log_at: Callable[[Floats], Floats]) -> Floats:
    """Return the diffusivity a (g,) at ghosts, extrapolated along the line through the boundary and the mirror point.

    If the mirror point is nearer to the boundary than the point at which sources are read, it may be on either side
    because of rounding; the line then goes through the point of sources. ``log_at`` returns log a (k,) at points (k,
    d).
    """
    first = log_at(ghosts.sources.points)
    at_boundary = _add_log_terms(ghosts.sources.coefficient * first, ghosts.sources, log_at)
    by_sources, by_mirror = np.flatnonzero(ghosts.behind < 1), np.flatnonzero(ghosts.behind >= 1)
    log = at_boundary.copy()
    log[by_sources] -= ghosts.behind[by_sources] * (first - at_boundary)[by_sources]
    log[by_mirror] += at_boundary[by_mirror] - log_at(ghosts.formula.points[by_mirror])
    return np.exp(log)


def _add_log_terms(values: Floats, formula: RowFormula, log_at: Callable[[Floats], Floats]) -> Floats:
    """Return ``values`` (n,), the first terms of log a, plus the terms ``coefficient * log a`` of further points.

    a is the diffusivity; ``log_at`` returns log a (k,) at points (k, d).
    """
    total = values.copy()
    for term in formula.terms:
        np.add.at(total, term.rows, term.coefficient * log_at(term.points))
    return total


def _advection_weights(tables: Discretization, velocity: VectorField, diffusive: Floats) -> Floats:
    """Return the weights (n, 2 d) of the difference neighbours in ``spacing^2 v . grad u``, by central differences.

    ``diffusive`` (n, 2 d) are the weights of diffusion; neighbours are in the order of :func:`cross_offsets`. Raises
    InputError if the velocity has not d coordinates. Raises ResolutionError if at any unknown advection over one
    spacing is more than twice as strong as diffusion: the solution would oscillate.
    """
    spacing, dim = tables.layout.lattice.spacing, tables.layout.lattice.dim
    v = tables.read_at_rows(velocity, "the velocity", None)[tables.unknowns.row_of_unknown]
    if v.shape[1] != dim:
        raise InputError(f"the velocity must be vectors of shape (n, {dim}), got (n, {v.shape[1]}).")
    peclet = float((np.abs(v).max(axis=1) * spacing / diffusive.min(axis=1)).max(initial=0.0))
    if peclet > MOST_CELL_PECLET:
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the velocity: over one spacing advection outweighs diffusion "
            f"{peclet:.3g} times, and above {MOST_CELL_PECLET:g} the solution oscillates; use "
            f"{spacing * MOST_CELL_PECLET / peclet:.2g} or less."
        )
    return np.asarray(0.5 * spacing * v @ cross_offsets(dim).T)
