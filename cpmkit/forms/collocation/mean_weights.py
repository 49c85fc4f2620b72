"""Means over the components of a manifold, with which free constants are removed and wrong means corrected.

An integral over the manifold is the integral over the surrounding space of the extended function times a bump in the
distance (Kublik and Tsai 2016; for an even bump their Jacobian is 1 to second order). The plain mean over a band's
nodes is not the mean over the manifold: the band is thicker where the surface is oblique to the lattice.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.extension_operator import ExtensionOperator, build_operator
from cpmkit.forms.data_checks import EXPLAINED_DEFECT_FACTOR, GROSS_DEFECT_SHARE, IMBALANCE_PER_ERROR, Imbalance
from cpmkit.linear.operators import Border, Bordered
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.scene.edge_conditions import edge_condition
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, SparseMatrix

#: Nodes farther past an end than this many spacings have weight zero.
TAIL_SPACINGS = 2.0
#: Least distance past or from an end, in spacings, that is divided by.
LEAST_END_DISTANCE_SPACINGS = 1e-6
#: If nodes past ends reduce a component's total weight below this share, its mean is the plain mean of its nodes.
PAST_END_WEIGHT_SHARE = 0.5
#: Means are corrected if c times the square of the surface's size is below this: a lost flux then shifts u by a
#: constant.
SMALL_REACTION = 10.0
#: A mean that was wrong by more than this share of the range of u is reported.
REPORTED_MEAN_SHARE = 1e-2
#: A u that varies by less than this share of its size counts as constant: rounding is not reported.
CONSTANT_RANGE_SHARE = 1e-6


def mean_weights(tables: Discretization) -> Floats:
    """Return the weight (n,), not normalised, of each unknown in means over the components of a manifold.

    The weight of a node is a function of its distance from the manifold. Nodes past an edge, and ghosts, continue the
    solution past the end of their component; their weight depends also on how far past the end they are. Without them
    the mean would have an error of first order, since the end is between nodes.
    """
    bump, beyond = _bumps_and_distances_past_ends(tables)
    return bump * _tail_weights(beyond)


def _bumps_and_distances_past_ends(tables: Discretization) -> tuple[Floats, Floats]:
    """Return the bump (n,) at each unknown, a factor of its weight, and how far (n,) the unknown is past an end.

    The bump is a window in the distance from the manifold, for ghosts times the tail weight of their node. The distance
    past the edge of the component, or for ghosts past their boundary, is in spacings: 0 for unknowns past neither, and
    `TAIL_SPACINGS` for ghosts whose distance is unknown.
    """
    band, inner = tables.layout.band, tables.layout.band.inner
    reach = 0.5 * (band.degree + 1) * band.spacing
    offset = (band.positions - band.feet.points)[:inner]
    past = _distances_past_edge(tables, offset)
    distance = np.sqrt(np.maximum(np.sum(offset**2, axis=1) - past**2, 0.0))
    # The spectrum of the Kaiser-Bessel window is zero at the lattice's own frequency and below 1e-3 of its peak at all
    # higher frequencies, so that sums hardly depend on the position of the lattice.
    shape = np.pi * np.sqrt((band.degree + 1.0) ** 2 - 1.0)
    window = np.i0(shape * np.sqrt(np.maximum(1.0 - (distance / reach) ** 2, 0.0))) / np.i0(shape)
    at_nodes = np.where(distance < reach, window, 0.0)
    bumps, beyond = [at_nodes], [past / band.spacing]
    for view, ghosts in zip(tables.layout.boundaries.side_views, tables.layout.ghosts, strict=True):
        of_node = np.full(len(band.nodes), TAIL_SPACINGS)
        of_node[view.rows] = np.nan_to_num(np.abs(view.signed) / band.spacing, nan=TAIL_SPACINGS)
        nodes = ghosts.nodes[: ghosts.unknowns]
        bumps.append(at_nodes[nodes] * _tail_weights(beyond[0][nodes]))
        beyond.append(of_node[nodes])
    return np.concatenate(bumps), np.concatenate(beyond)


def _distances_past_edge(tables: Discretization, offset: Floats) -> Floats:
    """Return how far (inner,) along the manifold each inner node is past an edge, zero for other nodes.

    With t that distance, r the node's height over the tangent plane and k the curvature, the mirror point is at the
    distance ``t (1 + k r)`` from the closest point; in that direction the node is at ``t (1 + k r / 2)``. At order 1
    there is no mirror point, and zero is returned. ``offset`` (inner, d) are the nodes minus their closest points.
    """
    band = tables.layout.band
    rows = np.flatnonzero(band.feet.edge[: len(offset)] >= 0)
    inwards = tables.layout.formula.points[rows] - band.feet.points[rows]
    length = norms(inwards)
    # the mirror point of a node at the end equals the end up to rounding
    has_mirror = length > LEAST_END_DISTANCE_SPACINGS * band.spacing
    along = np.divide(-dots(offset[rows], inwards), length, out=np.zeros(len(rows)), where=has_mirror)
    past = np.zeros(len(offset))
    past[rows] = np.maximum(2 * along - length, 0.0)
    return past


def _tail_weights(beyond: Floats) -> Floats:
    """Return the weights (n,) of nodes ``beyond`` (n,) spacings past an end: 1 at 0, and 0 from ``TAIL_SPACINGS`` on.

    With t the first node's distance, ``tail(t) + tail(t + 1) = 1/2 - t``: the end correction of the trapezoidal rule,
    with which a sum along one line of nodes is of second order. The weight is continuous, and its first moment
    vanishes, so that the mean of such sums over all positions t of the end is of third order.
    """
    t = np.mod(beyond, 1.0)
    first = 1.0 - 3.5 * t + 2.0 * t**2
    return np.where(beyond < 1.0, first, np.where(beyond < TAIL_SPACINGS, 0.5 - t - first, 0.0))


def mean_matrix(tables: Discretization, count: int, component: Ints) -> tuple[SparseMatrix, Ints, Ints]:
    """Return the matrix (count, n) of means over components, the unknowns (m,) on them, and their components (m,).

    ``component`` (n,) is that of each unknown, from 0 to ``count`` - 1, or -1 for none. If unknowns past ends make the
    total weight too small, the mean is the plain mean over the component's nodes.
    """
    from scipy.sparse import csr_array

    members = np.flatnonzero(component >= 0)
    component = component[members]
    smooth, is_node = mean_weights(tables)[members], members < tables.layout.band.inner

    def total(values: Floats) -> Floats:
        return np.bincount(component, values, count).astype(np.float64)

    wide = total(smooth) > PAST_END_WEIGHT_SHARE * total(np.where(is_node, np.maximum(smooth, 0.0), 0.0))
    weights = np.where(wide[component], smooth, is_node)
    weights = np.asarray(weights / total(weights)[component])
    return csr_array((weights, (component, members)), shape=(count, tables.unknowns.count)), members, component


# Free constants: the solution of mean zero is taken on each component on which u + constant is a solution if u is one.


def with_smooth_means(tables: Discretization, border: Border) -> Border:
    """Return the ``border`` of free constants with means over the manifold in place of plain means over unknowns."""
    component = np.full(tables.unknowns.count, -1)
    indicator = border.indicator.tocoo()
    component[indicator.row] = indicator.col
    return replace(border, mean=mean_matrix(tables, border.mean.shape[0], component)[0])


def describe_imbalances(
    tables: Discretization, scene: Scene, operator: Bordered, imbalances: Iterable[Imbalance], source_error: float
) -> tuple[Imbalance, ...]:
    """Return ``imbalances``, one a piece of the border, with new fields size, explained, near, share and bounded_by.

    The lowest order of the conditions, 1 or 2, decides how large an imbalance the spacing explains, in addition to
    ``source_error``, that of the manifold's source as a share of the range of u.
    """
    layout, described = tables.layout, []
    order = min([layout.options.own.order, *(condition.order for condition in scene.conditions if condition.order)])
    indicator = operator.border.indicator.toarray().T
    for imbalance, piece, size in zip(imbalances, indicator, _data_sizes(tables, scene, operator), strict=True):
        members = np.flatnonzero(piece)
        feet = layout.band.feet.points[members[members < layout.band.inner]]
        spacings = max(float(np.ptp(feet, axis=0).max()) / layout.lattice.spacing, 1.0)
        explained = EXPLAINED_DEFECT_FACTOR / spacings**order + IMBALANCE_PER_ERROR * source_error
        place = {**_describe_place(tables, scene, members), "explained": min(explained, GROSS_DEFECT_SHARE)}
        described.append(replace(imbalance, size=tuple(size.tolist()), **place))
    return tuple(described)


def _data_sizes(tables: Discretization, scene: Scene, operator: Bordered) -> Floats:
    """Return, by piece, the mean absolute value (pieces, channels) of f plus that of the fluxes through its ends."""
    indicator, stiffness = operator.border.indicator, cast("ExtensionOperator", operator.operator)
    f = np.abs(tables.read_sources(scene.problem.terms().f, "the right-hand side f"))
    fluxes = np.abs(tables.datum()[tables.unknowns.row_of_unknown])
    conductivity = stiffness.scale * float(np.abs(stiffness.differences.data).max())
    total = np.maximum(indicator.T @ np.maximum(mean_weights(tables), 0.0), np.finfo(float).tiny)[:, None]
    is_node = (np.arange(len(f)) < tables.layout.band.inner) * 1.0
    mean_f = (indicator.T @ (is_node[:, None] * f)) / (indicator.T @ is_node)[:, None]
    # the datum of an unknown t past an end is 2 t gamma for a flux gamma
    bump, beyond = _bumps_and_distances_past_ends(tables)
    t = np.clip(beyond, LEAST_END_DISTANCE_SPACINGS, TAIL_SPACINGS)
    end_weights = bump * np.minimum(0.5, 0.5 * (TAIL_SPACINGS - t) / t)
    flux = indicator.T @ (end_weights[:, None] * fluxes) * conductivity / total
    return np.asarray(mean_f + flux)


def _describe_place(tables: Discretization, scene: Scene, members: Ints) -> dict[str, Any]:
    """Return the fields near, share, bounded_by of an imbalance on a component of unknowns ``members``, ascending."""
    layout = tables.layout
    nodes = members[: np.searchsorted(members, layout.band.inner)]
    middle = layout.band.feet.points[nodes[[len(nodes) // 2]]]
    inside = np.zeros(tables.unknowns.count, dtype=bool)
    inside[members] = True
    walls = []
    for index, (boundary, ghosts) in enumerate(zip(scene.boundaries, layout.ghosts, strict=True)):
        on_component, left = inside[tables.unknowns.unknowns_of(index)], ghosts.continues_left[: ghosts.unknowns]
        sides = [side for side, of_side in (("left", left), ("right", ~left)) if np.any(on_component & of_side)]
        walls += [f"{boundary.name!r} ({side})" for side in sides]
    return {
        "near": tuple(layout.lattice.to_scene(middle)[0].tolist()),
        "share": len(nodes) / layout.band.inner,
        "bounded_by": tuple(walls),
    }


# Means. The integral of -div(a grad u) over a closed surface, or over one between walls, is zero, so c times the mean
# of u is the mean of f. The closest point method is not conservative: on meshes with creases and thin parts a
# small flux is lost or gained, and where c is small the mean of u is off by that flux over c.


def closed_components(tables: Discretization, scene: Scene) -> tuple[int, Ints]:
    """Return the number of components that no flux leaves, and each unknown's component (n,), -1 elsewhere.

    If a boundary has ghosts, there are none; otherwise these are the components whose edges all have zero flux, and
    components without edges.
    """
    if tables.unknowns.count > tables.layout.band.inner:
        return 0, np.full(tables.unknowns.count, -1)
    count, label = build_operator(tables, Terms()).pieces()
    closed = np.ones(count, dtype=bool)
    edge = tables.layout.band.feet.edge[: tables.layout.band.inner]
    for loop in np.unique(edge[edge >= 0]):
        if not edge_condition(scene.edge, int(loop)).law.is_zero_flux:
            closed[label[edge == loop]] = False
    return int(closed.sum()), np.where(closed, np.cumsum(closed) - 1, -1)[label]


def correct_means(tables: Discretization, scene: Scene, b: Floats, u: Floats) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return u (n, channels), shifted on closed components so that c mean(u) = mean(f), and the corrected imbalances.

    u is returned unchanged if a boundary has ghosts, c varies or is not positive (as for Helmholtz), there is a
    velocity, or c is so large that a lost flux changes u locally and not by a constant. On a component with edges means
    are less exact: there u is corrected only if the imbalance is large and the order is 2. ``b`` (n, channels): the
    right-hand side.
    """
    terms, layout = scene.problem.terms(), tables.layout
    if callable(terms.c) or terms.c <= 0 or terms.velocity is not None:
        return u, ()
    if terms.c * float(np.ptp(layout.band.feet.points, axis=0).max()) ** 2 > SMALL_REACTION:
        return u, ()
    count, component = closed_components(tables, scene)
    if not count:
        return u, ()
    mean, members, component = mean_matrix(tables, count, component)
    defect = terms.c * (mean @ u) - mean @ b  # without conditions b is f
    open_components = np.unique(component[layout.band.feet.edge[members] >= 0])
    shift, corrected = np.zeros_like(defect), []
    for k in range(count):
        on_component = members[component == k]
        values = u[on_component]
        span = np.maximum(np.ptp(values, axis=0), CONSTANT_RANGE_SHARE * np.abs(values).max(axis=0))
        imbalance = Imbalance(
            "mean",
            value=tuple(defect[k].tolist()),
            size=tuple((terms.c * span).tolist()),
            explained=REPORTED_MEAN_SHARE,
            **_describe_place(tables, scene, on_component),
            shift=tuple((-defect[k] / terms.c).tolist()),
        )
        if k in open_components and (imbalance.relative <= REPORTED_MEAN_SHARE or layout.options.own.order == 1):
            continue
        shift[k] = imbalance.shift
        corrected.append(imbalance)
    u = u.copy()
    u[members] += shift[component]
    return u, tuple(corrected)
