"""What a layout does not do justice to: boundaries without effect or against each other, gaps that are bridged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import ResolutionError, SceneError, place
from cpmkit.forms.collocation.diagnosis.effect import check_given
from cpmkit.forms.collocation.encounters.boundaries import DIFFERENT, Strip
from cpmkit.forms.collocation.encounters.facing_rims import BRIDGED, WIDE
from cpmkit.forms.collocation.layout import Layout
from cpmkit.protocols import SIDES, Floats, Ints
from cpmkit.scene.alike import alike
from cpmkit.scene.condition import Condition
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Interface, Nonlinear, Value, data_of
from cpmkit.scene.scene import Scene, edge_condition

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: A curve is seen at a spacing of this share of its extent.
SEEN = 0.25
#: Entries of tables that are looked through at a time.
CHUNK = 1 << 17


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
    check_given(scene, layout)


def check_effect(layout: Layout, extension: csr_array, neighbours: Ints) -> None:
    """Refuse boundaries whose ghosts no node reads, unless what is at their place holds the same.

    Raises
    ------
    ResolutionError
        If there is one.
    """
    numbering, nodes, inner = layout.numbering, layout.numbering.nodes, layout.numbering.inner
    read, stepped = np.zeros(extension.shape[1], dtype=bool), np.zeros(extension.shape[0], dtype=bool)
    for start in range(0, extension.indptr[nodes], CHUNK):
        read[extension.indices[start : min(start + CHUNK, extension.indptr[nodes])]] = True
    for start in range(0, inner, CHUNK):
        stepped[neighbours[start : min(start + CHUNK, inner)]] = True
    repeated = {one.second for one in layout.strips if one.coincide}
    repeated |= {one.boundary for one in layout.rim_strips if one.on_rim}
    for number in range(len(layout.ghosts)):
        seen = read[numbering.unknowns_of(number)].any() or stepped[numbering.rows_of(number)].any()
        if not seen and number not in repeated:
            raise ResolutionError(_without_effect(layout, number))


def _without_effect(layout: Layout, number: int) -> str:
    """Return the sentence on a boundary that the lattice does not see."""
    seen, spacing = layout.boundaries.on_lattice[number], layout.lattice.spacing
    samples, extent = seen.samples, float(np.linalg.norm(np.ptp(seen.source.bounds, axis=0)))
    near = place(layout.lattice.to_scene(samples.mean(axis=0)[None])[0])
    cure = min(SEEN * extent, 0.5 * spacing) or 0.5 * spacing
    return (
        f"spacing={spacing:g} is too coarse for boundary {layout.boundaries.given[number].name!r} near {near}, "
        f"{extent:.3g} in extent: it would have no effect; use {cure:.2g} or less."
    )


def _check_fluxes_at_points(layout: Layout) -> None:
    for boundary, seen in zip(layout.boundaries.given, layout.boundaries.on_lattice, strict=True):
        kinds = {one.kind for one in map(boundary.condition, SIDES) if not isinstance(one.law, Value)}
        if seen.has_sides or not kinds:
            continue
        raise SceneError(
            f"boundary {boundary.name!r}: a {' or '.join(sorted(kinds))} condition at a point of a surface, or a point "
            "or curve of a solid, has no effect: what flows through so little vanishes with the spacing; if a point "
            "source is meant, let f be a narrow bump with its strength as the integral, or use a small circle or tube."
        )


def _check_same_place(layout: Layout, scene: Scene) -> None:
    for one in layout.strips:
        if one.coincide and _contradict(layout, one, scene.problem.start_time):
            names = [layout.boundaries.given[number].name for number in (one.first, one.second)]
            raise SceneError(
                f"boundaries {names[0]!r} and {names[1]!r} lie at the same place, near {place(one.point)}, and hold "
                "different conditions; keep one of them, with `left` and `right` where its sides differ."
            )


def _contradict(layout: Layout, strip: Strip, time: float | None) -> bool:
    first, second = (layout.boundaries.given[number] for number in (strip.first, strip.second))
    return any(
        not _alike(first.condition(a), second.condition(b), strip.point[None], layout.channels, time)
        for a, b in zip(SIDES, SIDES[::-1] if strip.reversed else SIDES, strict=True)
    )


def _alike(one: Condition, other: Condition, points: Floats, channels: int, time: float | None) -> bool:
    """Tell whether two conditions hold the same at ``points`` (k, d) of the scene."""
    if alike(one, other):
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
        if np.abs(pair[0] - pair[1]).max() > DIFFERENT * np.abs(pair).max():
            return False
    return True


def _check_rims(layout: Layout, scene: Scene) -> None:
    spacing, time = layout.lattice.spacing, scene.problem.start_time
    for one in layout.rim_strips:
        boundary, edge = layout.boundaries.given[one.boundary], edge_condition(scene.edge, one.loop)
        conditions = [boundary.condition(side) for side in SIDES]
        if one.on_rim and not all(_alike(each, edge, one.points, layout.channels, time) for each in conditions):
            raise SceneError(
                f"boundary {boundary.name!r} lies on the manifold's rim, near {place(one.points[0])}, where the edge "
                f"holds another condition; give it as `edge=` (loop {one.loop}) in place of the boundary."
            )
        if not one.on_rim and conditions[0].couples:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for boundary {boundary.name!r}, whose sides are coupled: near "
                f"{place(one.points[0])} it runs {one.width:.3g} from the manifold's rim; use {one.width / 3:.2g} or "
                "less."
            )


def _check_gaps(layout: Layout) -> None:
    spacing = layout.lattice.spacing
    for one in layout.facing:
        if not one.local and one.gap <= BRIDGED * spacing:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for the gap of {one.gap:.3g} between rims of the manifold near "
                f"{place(one.point)}: it would be bridged, and what holds on the rims there would have no effect; use "
                f"{one.gap / WIDE:.2g} or less, or join the rims."
            )
