"""From tables and an equation's terms to the operator A."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.errors import InputError, ResolutionError, SceneError
from cpmkit.forms.collocation.boundary.row_formula import RowFormula
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.ghosts.ghosts import Ghosts
from cpmkit.forms.collocation.operator import ExtensionOperator
from cpmkit.grid.stencils import cross_offsets
from cpmkit.protocols import Floats
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.equations import Terms, VectorField

#: Central differences oscillate where advection over one spacing outweighs diffusion by more than this.
MOST_CELL_PECLET = 2.0
#: A mirror point nearer to its boundary than this share of the spacing may lie on either side, to rounding.
AMBIGUOUS_MIRROR_SPACINGS = 1e-3


def build_operator(tables: Discretization, terms: Terms) -> ExtensionOperator:
    """Return A of an equation's terms.

    Raises
    ------
    InputError
        If a coefficient is not a number or a callable of points, or a diffusivity is not above zero.
    ResolutionError
        If the spacing is too coarse for the velocity.
    """
    layout = tables.layout
    spacing, dim = layout.lattice.spacing, layout.lattice.dim
    scale = 1.0 / spacing**2
    c = _coefficient(tables, terms.c, "the factor c")
    if not callable(terms.diffusivity) and terms.velocity is None:
        a = float(_coefficient(tables, terms.diffusivity, "the diffusivity")[0, 0])
        diagonal = c + 2 * dim * a * scale
        constant = not callable(terms.c)
        return ExtensionOperator(
            tables.extension, tables.differences, float(diagonal[0, 0]) if constant else diagonal, a * scale
        )
    at_rows = _diffusivity(tables, terms.diffusivity)
    # The weights (n, 2 d) of the neighbours in spacing^2 div(a grad u): a at the midpoints.
    weights = 0.5 * (at_rows[tables.numbering.row_of_unknown][:, None] + at_rows[tables.neighbours])
    diagonal = c + scale * weights.sum(axis=1, keepdims=True)
    if terms.velocity is not None:
        weights = weights - _advective(tables, terms.velocity, weights)
    return ExtensionOperator(tables.extension, tables.weighted_differences(weights), diagonal, scale)


def _coefficient(tables: Discretization, data: Data, what: str) -> Floats:
    """Return a coefficient of one channel at the unknowns, (n, 1)."""
    if not callable(data):
        return np.full((tables.unknowns.count, 1), evaluate_data(data, np.zeros((1, 1)), 1, what)[0, 0])
    return tables.read_at_rows(data, what)[tables.numbering.row_of_unknown]


def _diffusivity(tables: Discretization, data: Data) -> Floats:
    """Return a (rows,) at all rows of E, continued across boundaries and past edges.

    Held constant there it would be wrong by O(spacing) where the flux is not zero, and so would be the solution beside
    Neumann and Robin conditions (measured on a circle: order 1.0). Its logarithm is continued, which stays above zero.
    """
    layout = tables.layout

    def log_at(points: Floats) -> Floats:
        a = evaluate_data(data, layout.lattice.to_scene(points), 1, "the diffusivity")[:, 0]
        if np.any(a <= 0):
            raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
        return np.asarray(np.log(a))

    reading, sources = layout.formula, layout.sources
    apart = np.linalg.norm(reading.points - sources.points, axis=1, keepdims=True)
    near = apart < AMBIGUOUS_MIRROR_SPACINGS * layout.lattice.spacing
    at_sources, mirror = log_at(sources.points), log_at(np.where(near, sources.points, reading.points))
    log = np.where(sources.coefficient == 1, 2 * at_sources - mirror, sources.coefficient * at_sources)
    return np.concatenate([np.exp(_with_terms(log, sources, log_at)), *(_of_ghosts(g, log_at) for g in layout.ghosts)])


def _of_ghosts(ghosts: Ghosts, log_at: Callable[[Floats], Floats]) -> Floats:
    """Return a (g,) at ghosts, continued along the line through the boundary and their mirror point.

    Where that lies nearer to the boundary than what is read within the side, it may be on either: the line goes there.
    """
    first = log_at(ghosts.sources.points)
    at_ghosts = _with_terms(ghosts.sources.coefficient * first, ghosts.sources, log_at)
    near, far = np.flatnonzero(ghosts.behind < 1), np.flatnonzero(ghosts.behind >= 1)
    log = at_ghosts.copy()
    log[near] -= ghosts.behind[near] * (first - at_ghosts)[near]
    log[far] += at_ghosts[far] - log_at(ghosts.formula.points[far])
    return np.exp(log)


def _with_terms(values: Floats, reading: RowFormula, log_at: Callable[[Floats], Floats]) -> Floats:
    """Return ``values`` (n,) and what the terms of a reading add."""
    total = values.copy()
    for term in reading.terms:
        np.add.at(total, term.rows, term.coefficient * log_at(term.points))
    return total


def check_terms(terms: Terms) -> None:
    """Refuse terms that the form has no rows for.

    Raises
    ------
    SceneError
        With what to do instead.
    """
    if terms.conservative:
        raise SceneError(
            "the form 'collocation' has v . grad u, not div(v u); leave `conservative` out and add div v to c, or use "
            "form='galerkin'."
        )


def _advective(tables: Discretization, velocity: VectorField, diffusive: Floats) -> Floats:
    """Return the weights (n, 2 d) of the neighbours in ``spacing^2 v . grad u``, by central differences.

    Raises
    ------
    InputError
        If the velocity has another number of coordinates.
    ResolutionError
        If advection over one spacing outweighs diffusion more than twice: the solution would oscillate.
    """
    spacing, dim = tables.layout.lattice.spacing, tables.layout.lattice.dim
    v = tables.read_at_rows(velocity, "the velocity", None)[tables.numbering.row_of_unknown]
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
