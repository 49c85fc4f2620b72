"""Means over the components of a manifold, free constants taken out by them, and means that are corrected.

The integral over the manifold is that over the space around it, of the extension times a bump in the distance
(Kublik and Tsai 2016, whose Jacobian an even bump makes 1 to second order). The plain mean over a band's nodes is
not one over the manifold: the band is thicker where the surface is oblique to the lattice.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.collocation.components import components_without_flux, parts_of_nodes, singular_components
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.extension_operator import ExtensionOperator
from cpmkit.forms.free_constants import EXPLAINED_DEFECT_FACTOR, GROSS_DEFECT_SHARE, Imbalance
from cpmkit.linear.operators import Border, Bordered
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Nodes farther past an end than this many spacings weigh nothing.
TAIL_SPACINGS = 2.0
#: Nothing is divided by a smaller distance past or from an end, in spacings.
LEAST_END_DISTANCE_SPACINGS = 1e-6
#: Nodes past an end may reduce the total weight of a component to this share; below it, on a component hardly wider
#: than their reach, the mean is taken over the component's own nodes alone.
PAST_END_WEIGHT_SHARE = 0.5
#: Means are corrected where c times the square of the surface's size is below this: there a flux that is lost anywhere
#: shifts u by a constant.
SMALL_REACTION = 10.0
#: A mean that was wrong by more than this share of the range of u is reported.
REPORTED_MEAN_SHARE = 1e-2
#: A u that varies by less than this share of its size counts as constant: rounding is not reported.
CONSTANT_RANGE_SHARE = 1e-6


def mean_weights(tables: Discretization) -> Floats:
    """Return the weight (n,) of each unknown in means over the components of a manifold.

    A node weighs by its distance from the manifold. Nodes past an edge, and ghosts, continue the solution past the
    end of their component; they weigh by how far past it they are, so that the end need not fall on a node. Without
    them the mean is off in first order (a cap, spacing 0.05: by 3e-3 of the range, with them by 6e-4).
    """
    bump, beyond = _bumps_and_ends(tables)
    return bump * _tail(beyond)


def _end_weights(tables: Discretization) -> Floats:
    """Return the weight (n,) in fluxes of the boundary data at each unknown, ``2 t gamma`` at t past an end.

    The sum, over that of the mean's weights and the square of the spacing, is the flux gamma through the ends over
    the measure of the component.
    """
    bump, beyond = _bumps_and_ends(tables)
    t = np.clip(beyond, LEAST_END_DISTANCE_SPACINGS, TAIL_SPACINGS)
    return bump * np.minimum(0.5, 0.5 * (TAIL_SPACINGS - t) / t)


def _bumps_and_ends(tables: Discretization) -> tuple[Floats, Floats]:
    """Return the bump's value at each unknown (n,), and how many spacings it lies past the end of its component."""
    band, inner = tables.layout.band, tables.layout.band.inner
    reach = 0.5 * (band.degree + 1) * band.spacing
    offset = (band.positions - band.feet.points)[:inner]
    past = _past_edge(tables, offset)
    distance = np.sqrt(np.maximum(np.sum(offset**2, axis=1) - past**2, 0.0))
    at_nodes = _bump(distance / reach, band.degree)
    bumps, beyond = [at_nodes], [past / band.spacing]
    for view, ghosts in zip(tables.layout.boundaries.side_views, tables.layout.ghosts, strict=True):
        of_node = np.full(len(band.nodes), TAIL_SPACINGS)
        of_node[view.rows] = np.nan_to_num(np.abs(view.signed) / band.spacing, nan=TAIL_SPACINGS)
        nodes = ghosts.nodes[: ghosts.unknowns]
        bumps.append(at_nodes[nodes] * _tail(beyond[0][nodes]))
        beyond.append(of_node[nodes])
    return np.concatenate(bumps), np.concatenate(beyond)


def _past_edge(tables: Discretization, offset: Floats) -> Floats:
    """Return how far along the manifold each inner node (n,) lies past an edge, zero where it does not.

    With t that distance, r the node's height over the tangent plane and k the curvature, the mirror point lies
    ``t (1 + k r)`` from the foot, in a direction along which the node is ``t (1 + k r / 2)`` from it. At order 1
    there is no mirror point, and zero is returned.
    """
    band = tables.layout.band
    rows = np.flatnonzero(band.feet.edge[: len(offset)] >= 0)
    inwards = tables.layout.formula.points[rows] - band.feet.points[rows]
    length = np.linalg.norm(inwards, axis=1)
    # the mirror point of a node beside the end is the end itself, to rounding
    has_mirror = length > LEAST_END_DISTANCE_SPACINGS * band.spacing
    along = np.divide(-np.sum(offset[rows] * inwards, axis=1), length, out=np.zeros(len(rows)), where=has_mirror)
    past = np.zeros(len(offset))
    past[rows] = np.maximum(2 * along - length, 0.0)
    return past


def _bump(distance: Floats, degree: int) -> Floats:
    """Return the Kaiser-Bessel window at distances in units of its radius, ``(degree + 1) / 2`` spacings.

    Its spectrum is zero at the lattice's own frequency and below 1e-3 of its peak at all higher ones, so that sums
    hardly depend on where the nodes lie.
    """
    shape = np.pi * np.sqrt((degree + 1.0) ** 2 - 1.0)
    inside = np.i0(shape * np.sqrt(np.maximum(1.0 - distance**2, 0.0))) / np.i0(shape)
    return np.where(distance < 1.0, inside, 0.0)


def _tail(beyond: Floats) -> Floats:
    """Return the weight of a node ``beyond`` spacings past an end; at 0 it is 1, from ``TAIL_SPACINGS`` on 0.

    With t the first node's distance, ``tail(t) + tail(t + 1) = 1/2 - t``: the end correction of the trapezoidal
    rule. It is continuous, and its first moment vanishes, so that sums along a line are of third order.
    """
    t = np.mod(beyond, 1.0)
    first = 1.0 - 3.5 * t + 2.0 * t**2
    return np.where(beyond < 1.0, first, np.where(beyond < TAIL_SPACINGS, 0.5 - t - first, 0.0))


def means_over(tables: Discretization, count: int, component: Ints) -> tuple[csr_array, Ints, Ints]:
    """Return the means (count, n) over components, the unknowns on them, and their components; -1 is none."""
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


# Free constants. On a closed surface, or a component of one with Neumann conditions all around, u + constant solves the
# same problem as u, and the data must balance: what f brings in has to flow out. There the solution of mean zero is
# taken; the part of the data that does not balance, a constant on each component, is left out of f and reported.


def find_border(tables: Discretization, scene: Scene) -> Border | None:
    """Return the border that fixes free constants: indicators and means of components where no condition does."""
    from scipy.sparse import csr_array

    count, component = singular_components(tables, scene)
    if not count:
        return None
    mean, members, component = means_over(tables, count, component)
    indicator = csr_array((np.ones(len(members)), (members, component)), shape=(tables.unknowns.count, count))
    return Border(indicator, mean)


def remove_constants(
    tables: Discretization, scene: Scene, operator: Bordered, u: Floats
) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return the solution (n, channels) with mean zero on each component, and the data that do not balance."""
    u, means = operator.border.remove_means(u)
    sizes = _data_sizes(tables, scene, operator)
    defects = [
        _defect(tables, scene, operator.border, number, value, size)
        for number, (value, size) in enumerate(zip(operator.shift * means, sizes, strict=True))
    ]
    return u, tuple(defects)


def _data_sizes(tables: Discretization, scene: Scene, operator: Bordered) -> Floats:
    """Return the mean size (components, channels) of f, and of the fluxes through the ends, on each component."""
    indicator, stiffness = operator.border.indicator, operator.operator
    assert isinstance(stiffness, ExtensionOperator)
    f = np.abs(tables.read_sources(scene.problem.terms().f, "the right-hand side f"))
    fluxes = np.abs(tables.datum()[tables.numbering.row_of_unknown])
    conductivity = stiffness.scale * float(np.abs(stiffness.differences.data).max())
    total = np.maximum(indicator.T @ np.maximum(mean_weights(tables), 0.0), np.finfo(float).tiny)[:, None]
    is_node = (np.arange(len(f)) < tables.layout.band.inner) * 1.0
    mean_f = (indicator.T @ (is_node[:, None] * f)) / (indicator.T @ is_node)[:, None]
    flux = indicator.T @ (_end_weights(tables)[:, None] * fluxes) * conductivity / total
    return np.asarray(mean_f + flux)


def _defect(
    tables: Discretization, scene: Scene, border: Border, number: int, value: Floats, size: Floats
) -> Imbalance:
    """Return the imbalance ``value`` (channels,) of the data on a component; the order of its error is 1 or 2."""
    layout, band = tables.layout, tables.layout.band
    members = border.indicator.tocsc()[:, [number]].indices.astype(np.int64)
    nodes = members[members < band.inner]
    spacings = max(float(np.ptp(band.feet.points[nodes], axis=0).max()) / layout.lattice.spacing, 1.0)
    order = min([layout.order, *(condition.order for condition in scene.conditions if condition.order)])
    parts = 1
    if len(layout.ghosts) > 1:  # boundaries that cross may cut it into parts larger than a stencil
        sizes = np.bincount(parts_of_nodes(tables)[nodes])
        parts = max(int(np.count_nonzero(sizes > (band.degree + 1) ** band.dim)), 1)
    return Imbalance(
        "data",
        value=tuple(value.tolist()),
        size=tuple(size.tolist()),
        explained=min(EXPLAINED_DEFECT_FACTOR / spacings**order, GROSS_DEFECT_SHARE),
        **_place_of(tables, scene, members),
        parts=parts,
    )


def _place_of(tables: Discretization, scene: Scene, members: Ints) -> dict[str, Any]:
    """Return where a component is, by its sorted unknowns: a point of it, its share, the boundaries around it."""
    layout = tables.layout
    nodes = members[: np.searchsorted(members, layout.band.inner)]
    middle = layout.band.feet.points[nodes[[len(nodes) // 2]]]
    inside = np.zeros(tables.unknowns.count, dtype=bool)
    inside[members] = True
    walls = []
    for index, (boundary, ghosts) in enumerate(zip(scene.boundaries, layout.ghosts, strict=True)):
        on_component, left = inside[tables.numbering.unknowns_of(index)], ghosts.carries_left[: ghosts.unknowns]
        sides = [side for side, of_side in (("left", left), ("right", ~left)) if np.any(on_component & of_side)]
        walls += [f"{boundary.name!r} ({side})" for side in sides]
    return {
        "near": tuple(layout.lattice.to_scene(middle)[0].tolist()),
        "share": len(nodes) / layout.band.inner,
        "bounded_by": tuple(walls),
    }


# Means. Integrated over a closed surface, or one between walls, -div(a grad u) vanishes, so c times the mean of u is
# the mean of f. The operators of the closest point method do not conserve: on meshes with creases and thin parts a
# small flux is lost or gained, and where c is small the mean of u is off by that flux over c.


def correct_means(tables: Discretization, scene: Scene, b: Floats, u: Floats) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return u (n, channels) shifted on each component that nothing flows out of, and how far its mean was off there.

    Nothing is done where c varies or is zero, where there is a velocity, and where c is so large that a leak
    shows near its place and not as a constant; nor for small leaks of a component with edges, where means are less
    exact, or for any of it at order 1, where they are off by as much as u.
    """
    terms, layout = scene.problem.terms(), tables.layout
    if callable(terms.c) or terms.c <= 0 or terms.velocity is not None:
        return u, ()
    if terms.c * float(np.ptp(layout.band.feet.points, axis=0).max()) ** 2 > SMALL_REACTION:
        return u, ()
    count, component = components_without_flux(tables, scene)
    if not count:
        return u, ()
    mean, members, component = means_over(tables, count, component)
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
            **_place_of(tables, scene, on_component),
            shift=tuple((-defect[k] / terms.c).tolist()),
        )
        if k in open_components and (imbalance.relative <= REPORTED_MEAN_SHARE or layout.order == 1):
            continue
        shift[k] = imbalance.shift
        corrected.append(imbalance)
    u = u.copy()
    u[members] += shift[component]
    return u, tuple(corrected)
