"""Galerkin correction in polynomials of degree k: the solution balances fluxes against all of them.

Multiplied by a smooth v and integrated over a manifold that nothing flows out of, -div(a grad u) + c u = f says that
``int a grad u . grad v + c u v = int f v``. The operators of the closest point method do not conserve, so their
solution misses this by a little, everywhere where the surface bends. Here v runs over all polynomials in the
coordinates up to a degree, and the one combination of them is added to u with which all hold: the Galerkin correction
in their space, the coarse grid correction of a two-level method. The rest of the error is what polynomials cannot
tell: rough, and near its source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.collocation.conservation.balance import span_of
from cpmkit.forms.collocation.conservation.components import components_without_flux
from cpmkit.forms.collocation.conservation.polynomials import Polynomials
from cpmkit.forms.collocation.conservation.weak_form import WeakForm, curved_cells_of, weak_form
from cpmkit.forms.collocation.diagnosis.survey import find_unresolved
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.free_constants import Imbalance
from cpmkit.mesh.mixed_cells import member_dimensions
from cpmkit.protocols import Floats, HasMesh, Ints
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.scene import Scene

#: Combinations of polynomials are left out whose mean square is this small beside the largest: on a sphere, say,
#: x^2 + y^2 + z^2 is no other function than 1.
DEPENDENT_MEAN_SQUARE = 1e-10
#: Longest mesh edge in spacings: 2, or 1 at order 4, because quadratic cells integrate to fourth order.
BALANCE_EDGE_SPACINGS = {False: 2.0, True: 1.0}
#: A correction that changes u by more than this share of its range is reported.
TOLD_CORRECTION_SHARE = 0.05
#: A correction is rejected where it changes u by more than this multiple of the predicted error and by more than this
#: share of the range of u.
CORRECTION_OVER_FORETOLD, FAR_CORRECTION_SHARE = 3.0, 0.2
#: A node is on the piece that makes up more than this of what it reads.
MAIN_PIECE_SHARE = 0.5


def check_balance(scene: Scene, degree: int) -> None:
    """Refuse scenes whose fluxes are not balanced, if they are to be.

    Raises
    ------
    InputError
        In one sentence.
    """
    if degree == 0:
        return
    problem = scene.problem
    if problem.family != "steady":
        raise _refused(f"a problem of kind {problem.kind!r}", "steady ones, such as screened or poisson")
    terms = problem.terms()
    if terms.velocity is not None:
        raise _refused("a problem with a velocity", "problems without")
    if not callable(terms.c) and terms.c < 0:
        raise _refused(f"c = {terms.c:g}", "c of zero and above")
    if scene.boundaries:
        names = ", ".join(repr(boundary.name) for boundary in scene.boundaries)
        raise _refused(f"a scene with the boundaries {names}", "scenes without conditions inside")
    if not isinstance(scene.surface, HasMesh):
        raise _refused(f"the surface {type(scene.surface).__name__}, which has no mesh", "surfaces with a mesh")
    if len(member_dimensions(scene.surface)) > 1:
        raise _refused("a manifold of mixed dimensions", "manifolds of one")


def _refused(got: str, accepted: str) -> InputError:
    return InputError(f"balance was asked for {got}, and is for {accepted}; leave it out.")


@dataclass(frozen=True, eq=False)
class Balancing:
    """What balancing fluxes starts from.

    Attributes
    ----------
    weak : WeakForm
        What they are integrated with.
    count : int
        How many pieces nothing flows out of.
    piece : (n,) int64
        Which of them each unknown is on, -1 for none.
    """

    weak: WeakForm
    count: int
    piece: Ints


def prepare_balance(scene: Scene, tables: Discretization) -> Balancing:
    """Return what balancing the fluxes starts from; all that may be refused is refused here.

    Raises
    ------
    InputError
        If something flows out of every piece of the manifold, c is below zero somewhere, or the surface's mesh does
        not fill it.
    """
    count, piece = components_without_flux(tables, scene)
    if not count:
        raise _refused("a manifold with conditions on its edges", "pieces that are closed or end at walls")
    terms = scene.problem.terms()
    layout = tables.layout
    curved = curved_cells_of(scene.surface, BALANCE_EDGE_SPACINGS[layout.order == 4] * layout.lattice.spacing)
    a = evaluate_data(terms.diffusivity, curved.nodes, 1, "the diffusivity")[:, 0]
    c = evaluate_data(terms.c, curved.nodes, 1, "the factor c")[:, 0]
    if c.min(initial=0.0) < 0:
        raise _refused(f"a c that falls to {c.min():.3g}", "c of zero and above")
    return Balancing(weak_form(curved, a, c), count, piece)


#: Reads values (unknowns, channels) at points (n, d): (n, channels).
Read = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True, eq=False)
class Balanced:
    """The values with balanced fluxes, (unknowns, channels), what was done, and the queries that it took."""

    values: Floats
    balance: Imbalance
    queries: int


def galerkin_correction(
    tables: Discretization, scene: Scene, read: Read, raw: Floats, prepared: Balancing, degree: int, leaked: float
) -> Balanced | str:
    """Return values whose fluxes balance against all polynomials up to a degree, piece by piece.

    Where that would move u by more than can be explained, by what the spacing does not resolve or by what ``leaked``,
    a share of the range of u, a sentence says so instead.
    """
    terms, channels = scene.problem.terms(), raw.shape[1]
    weak, count, piece = prepared.weak, prepared.count, prepared.piece
    pieces = _pieces_of_nodes(read, weak.nodes, count, piece)
    u = read(raw, weak.nodes)
    missing = weak.mass @ evaluate_data(terms.f, weak.nodes, channels, "the right-hand side f")
    missing -= weak.form @ u
    values, added, functions = raw.copy(), np.zeros_like(u), 0
    for k in range(count):
        rows, unknowns = np.flatnonzero(pieces == k), piece == k
        if not len(rows):  # of a piece so small that its mesh misses it
            continue
        correction, found = _galerkin(weak, missing, rows, degree, terms.fixes_constant_at(weak.nodes[rows]))
        values[unknowns] += tables.read_sources(correction, "what balances the fluxes")[unknowns]
        added[rows] = correction(weak.nodes[rows])
        functions += found
    weights = weak.mass.sum(axis=1)
    span = span_of(u)
    rms = np.sqrt(weights @ added**2 / weights.sum())
    balance = Imbalance(
        "fluxes",
        value=tuple(rms.tolist()),
        size=tuple(span.tolist()),
        explained=TOLD_CORRECTION_SHARE,
        share=float(np.mean(piece[: tables.layout.band.inner] >= 0)),
        degree=degree,
        functions=functions,
    )
    if balance.relative > FAR_CORRECTION_SHARE:
        foretold = max([*(feature.error for feature in find_unresolved(tables.layout)), leaked])
        if balance.relative > CORRECTION_OVER_FORETOLD * foretold:
            return _not_applied(degree, balance.relative, foretold)
    # nodes were asked for when they were made, and when they were read
    return Balanced(values, balance, 2 * len(u))


def _not_applied(degree: int, moved: float, foretold: float) -> str:
    return (
        f"Balancing the fluxes against polynomials of degree {degree} was left out: it would move u by {moved:.1%} of "
        f"its range, and what the spacing does not resolve explains {foretold:.1%}; the integrals over the surface's "
        "mesh do not fit its closest points."
    )


def _pieces_of_nodes(read: Read, nodes: Floats, count: int, piece: Ints) -> Ints:
    """Return the piece (n,) on which each node lies, -1 for none; ``piece`` is that of each unknown."""
    if count == 1 and not piece.any():
        return np.zeros(len(nodes), dtype=np.int64)
    indicator = (piece[:, None] == np.arange(count)).astype(np.float64)
    share = read(indicator, nodes)
    return np.where(share.max(axis=1) > MAIN_PIECE_SHARE, share.argmax(axis=1), -1)


def _galerkin(
    weak: WeakForm, missing: Floats, rows: Ints, degree: int, pinned: bool
) -> tuple[Callable[[Floats], Floats], int]:
    """Return what to add to u on a piece, a function of points, and from how many functions it is made.

    Parameters
    ----------
    weak : WeakForm
    missing : (n, channels) float64
        ``int f v - a grad u . grad v - c u v`` for the function v of each node.
    rows : (k,) int64
        The nodes of the piece.
    degree : int
        Of the polynomials.
    pinned : bool
        False where u is known up to a constant: then the mean of u is left as it is.
    """
    nodes = weak.nodes[rows]
    polynomials = Polynomials(nodes.min(axis=0), nodes.max(axis=0), degree)
    values = polynomials.at(nodes)
    whole = len(rows) == len(weak.nodes)
    mass, form = (one if whole else one[rows][:, rows] for one in (weak.mass, weak.form))
    change = np.eye(values.shape[1])
    if not pinned:
        weights = mass.sum(axis=0)
        means = weights @ values / weights.sum()
        change[0] -= means  # the first polynomial is 1
        values -= means
    squares, axes = np.linalg.eigh(values.T @ (mass @ values))
    kept = squares > DEPENDENT_MEAN_SQUARE * squares[-1]
    combine = axes[:, kept] / np.sqrt(squares[kept])
    basis = values @ combine
    solved = np.linalg.solve(basis.T @ (form @ basis), basis.T @ missing[rows])
    return partial(polynomials.combined, change @ (combine @ solved)), int(kept.sum())
