"""Layouts that are refused: boundaries without effect, contradictory conditions, gaps that the spacing bridges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import ResolutionError, SceneError, place
from cpmkit.forms.collocation.diagnosis.effect import check_used
from cpmkit.forms.collocation.encounters.boundaries import DIFFERENT_DATA_SHARE, Strip
from cpmkit.forms.collocation.encounters.facing_rims import BRIDGED_GAP_SPACINGS, WIDE_GAP_SPACINGS
from cpmkit.forms.collocation.layout import Layout
from cpmkit.protocols import SIDES, Floats, Ints
from cpmkit.scene.conditions import Condition, same_condition
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.edge_conditions import edge_condition
from cpmkit.scene.laws import Interface, Nonlinear, Value, data_of
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: A curve is resolved at a spacing of this share of its extent.
RESOLVED_EXTENT_SHARE = 0.25
#: Entries of tables that are looked through at a time.
TABLE_CHUNK_ENTRIES = 1 << 17


def check_layout(layout: Layout, scene: Scene) -> None:
    """Refuse what would have no effect, or contradicts itself.

    Raises
    ------
    SceneError
        If two boundaries at one place hold different conditions, a boundary on a rim another than the edge, a flux is
        given where nothing can flow, a condition on an edge that is not there, or conductivities that are not those of
        the problem.
    ResolutionError
        If the spacing does not see a boundary, an edge, or a gap.
    InputError
        If the beta of a mixed law vanishes.
    """
    _check_fluxes_at_points(layout)
    _check_same_place(layout, scene)
    _check_rims(layout, scene)
    _check_gaps(layout)
    for number, ghosts in enumerate(layout.ghosts):
        if not ghosts.unknowns:
            raise ResolutionError(_without_effect(layout, number))
    check_used(scene, layout)


def check_effect(layout: Layout, extension: csr_array, neighbours: Ints) -> None:
    """Refuse boundaries whose ghosts no node reads, unless another boundary at the same place holds the same condition.

    Raises
    ------
    ResolutionError
        If there is one.
    """
    numbering, nodes, inner = layout.numbering, layout.numbering.nodes, layout.numbering.inner
    read, stepped = np.zeros(extension.shape[1], dtype=bool), np.zeros(extension.shape[0], dtype=bool)
    for start in range(0, extension.indptr[nodes], TABLE_CHUNK_ENTRIES):
        read[extension.indices[start : min(start + TABLE_CHUNK_ENTRIES, extension.indptr[nodes])]] = True
    for start in range(0, inner, TABLE_CHUNK_ENTRIES):
        stepped[neighbours[start : min(start + TABLE_CHUNK_ENTRIES, inner)]] = True
    repeated = {strip.second for strip in layout.strips if strip.coincide}
    repeated |= {strip.boundary for strip in layout.rim_strips if strip.on_rim}
    for number in range(len(layout.ghosts)):
        is_read = read[numbering.unknowns_of(number)].any() or stepped[numbering.rows_of(number)].any()
        if not is_read and number not in repeated:
            raise ResolutionError(_without_effect(layout, number))


def _without_effect(layout: Layout, number: int) -> str:
    """Return the sentence on a boundary that the lattice does not see."""
    sighted, spacing = layout.boundaries.on_lattice[number], layout.lattice.spacing
    samples, extent = sighted.samples, float(np.linalg.norm(np.ptp(sighted.source.bounds, axis=0)))
    near = place(layout.lattice.to_scene(samples.mean(axis=0)[None])[0])
    cure = min(RESOLVED_EXTENT_SHARE * extent, 0.5 * spacing) or 0.5 * spacing
    return (
        f"spacing={spacing:g} is too coarse for boundary {layout.boundaries.given[number].name!r} near {near}, "
        f"{extent:.3g} in extent: it would have no effect; use {cure:.2g} or less."
    )


def _check_fluxes_at_points(layout: Layout) -> None:
    for boundary, sighted in zip(layout.boundaries.given, layout.boundaries.on_lattice, strict=True):
        kinds = {one.kind for one in map(boundary.condition, SIDES) if not isinstance(one.law, Value)}
        if sighted.has_sides or not kinds:
            continue
        raise SceneError(
            f"boundary {boundary.name!r}: a {' or '.join(sorted(kinds))} condition at a point of a surface, or a point "
            "or curve of a solid, has no effect: what flows through so little vanishes with the spacing; if a point "
            "source is meant, let f be a narrow bump with its strength as the integral, or use a small circle or tube."
        )


def _check_same_place(layout: Layout, scene: Scene) -> None:
    for strip in layout.strips:
        if strip.coincide and _conditions_contradict(layout, strip, scene.problem.start_time):
            names = [layout.boundaries.given[number].name for number in (strip.first, strip.second)]
            raise SceneError(
                f"boundaries {names[0]!r} and {names[1]!r} lie at the same place, near {place(strip.point)}, and hold "
                "different conditions; keep one of them, with `left` and `right` where its sides differ."
            )


def _conditions_contradict(layout: Layout, strip: Strip, time: float | None) -> bool:
    first, second = (layout.boundaries.given[number] for number in (strip.first, strip.second))
    return any(
        not _hold_the_same(first.condition(a), second.condition(b), strip.point[None], layout.channels, time)
        for a, b in zip(SIDES, SIDES[::-1] if strip.reversed else SIDES, strict=True)
    )


def _hold_the_same(one: Condition, other: Condition, points: Floats, channels: int, time: float | None) -> bool:
    """Tell whether two conditions hold the same at ``points`` (k, d) of the scene."""
    if same_condition(one, other):
        return True
    first, second, unlike = one.law, other.law, (Interface, Nonlinear)
    if type(first) is not type(second) or isinstance(first, unlike) or isinstance(second, unlike):
        return False
    if first.alpha != second.alpha:
        return False
    data = [[law.beta, *(datum for _, datum in data_of(law))] for law in (first, second)]
    for a, b in zip(*data, strict=True):
        if a is b:
            continue
        pair = [evaluate_data(data, points, channels, "a condition", time) for data in (a, b)]
        if np.abs(pair[0] - pair[1]).max() > DIFFERENT_DATA_SHARE * np.abs(pair).max():
            return False
    return True


def _check_rims(layout: Layout, scene: Scene) -> None:
    spacing, time = layout.lattice.spacing, scene.problem.start_time
    for strip in layout.rim_strips:
        boundary, edge = layout.boundaries.given[strip.boundary], edge_condition(scene.edge, strip.loop)
        conditions = [boundary.condition(side) for side in SIDES]
        if strip.on_rim and not all(
            _hold_the_same(condition, edge, strip.points, layout.channels, time) for condition in conditions
        ):
            raise SceneError(
                f"boundary {boundary.name!r} lies on the manifold's rim, near {place(strip.points[0])}, where the edge "
                f"holds another condition; give it as `edge=` (loop {strip.loop}) in place of the boundary."
            )
        if not strip.on_rim and conditions[0].couples:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for boundary {boundary.name!r}, whose sides are coupled: near "
                f"{place(strip.points[0])} it runs {strip.width:.3g} from the manifold's rim; use "
                f"{strip.width / 3:.2g} or less."
            )


def _check_gaps(layout: Layout) -> None:
    spacing = layout.lattice.spacing
    for rims in layout.facing:
        if not rims.local and rims.gap <= BRIDGED_GAP_SPACINGS * spacing:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for the gap of {rims.gap:.3g} between rims of the manifold near "
                f"{place(rims.point)}: it would be bridged, and what holds on the rims there would have no effect; use "
                f"{rims.gap / WIDE_GAP_SPACINGS:.2g} or less, or join the rims."
            )
