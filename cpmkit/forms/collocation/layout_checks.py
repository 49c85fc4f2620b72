"""Checks of a layout, before any matrix: places that the spacing does not resolve, contradictions, unstable waves."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cpmkit.errors import InputError, ResolutionError, SceneError, place
from cpmkit.forms.collocation.band_layout import Layout
from cpmkit.forms.collocation.band_sheets import foot_directions
from cpmkit.forms.collocation.ghosts.transmission_ghosts import check_conductivities
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.side_view import ALONGSIDE_COSINE, STRIP_SPACINGS
from cpmkit.forms.options import Options
from cpmkit.manifold.abilities import advice_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.runtime.arrays import whole
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.laws import Interface, Value
from cpmkit.scene.point_values import small_boundary_warnings
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Ints, SparseMatrix

#: A curve is resolved at a spacing of this share of its extent.
RESOLVED_EXTENT_SHARE = 0.25
#: Leapfrog's step is at most this many spacings over (speed sqrt(d)). The largest eigenvalue of A is at most
#: 4 d speed^2 / spacing^2 (this on solids; on curves and surfaces 5.9 and 8.7 instead of 8 and 12), and damping
#: reduces the stable step.
LEAPFROG_MOST_SPACINGS = 0.85
#: The implicit scheme's step is at least this many spacings over speed: longer steps damp enough, for all degrees.
IMPLICIT_LEAST_SPACINGS = 0.3


def check_layout(layout: Layout, scene: Scene) -> None:
    """Raise if conditions would have no effect, or contradict each other.

    Raises SceneError if two boundaries at one place have different conditions, a condition is a flux at a point or for
    an edge that the manifold does not have, or conductivities differ from the problem's diffusivity; ResolutionError if
    the spacing does not resolve a boundary, or the strip between one with coupled sides and a rim.
    """
    _check_fluxes_at_points(layout)
    _check_same_place(layout)
    _check_coupled_beside_rims(layout)
    for number, ghosts in enumerate(layout.ghosts):
        if not ghosts.unknowns:
            raise ResolutionError(_no_effect_message(layout, number))
    _check_edges(scene, layout)
    _check_conductivities(scene, layout)


def check_effect(layout: Layout, extension: SparseMatrix, neighbours: Ints) -> None:
    """Raise ResolutionError if no node reads the ghosts of a boundary, which then has no effect.

    ``extension`` (rows, unknowns) is E, ``neighbours`` (unknowns, 2 d) the rows that difference stencils read. A
    boundary whose condition another boundary repeats at the same place is excepted.
    """
    unknowns, nodes, inner = layout.unknowns, len(layout.band.nodes), layout.band.inner
    is_read, is_neighbour = np.zeros(extension.shape[1], dtype=bool), np.zeros(extension.shape[0], dtype=bool)
    is_read[extension.indices[: extension.indptr[nodes]]] = True
    is_neighbour[neighbours[:inner]] = True
    repeated = {pair.numbers[-1] for pair in layout.parallel_pairs if pair.same_place}
    for number in range(len(layout.ghosts)):
        used = is_read[unknowns.unknowns_of(number)].any() or is_neighbour[unknowns.rows_of(number)].any()
        if not used and number not in repeated:
            raise ResolutionError(_no_effect_message(layout, number))


def _no_effect_message(layout: Layout, number: int) -> str:
    """Return the error message for the boundary with the index ``number``, which the lattice does not resolve."""
    boundary, spacing = layout.boundaries.on_lattice[number], layout.lattice.spacing
    extent = float(np.linalg.norm(np.ptp(boundary.source.bounds, axis=0)))
    middle = place(layout.lattice.to_scene(boundary.samples.mean(axis=0)[None])[0])
    resolved = min(RESOLVED_EXTENT_SHARE * extent, 0.5 * spacing) or 0.5 * spacing
    return (
        f"spacing={spacing:g} is too coarse for boundary {layout.boundaries.definitions[number].name!r} near {middle}, "
        f"{extent:.3g} in extent: it would have no effect; use {resolved:.2g} or less, or `edge` for a condition on "
        "the rim of the manifold."
    )


def _check_fluxes_at_points(layout: Layout) -> None:
    """Raise SceneError if a condition other than Dirichlet is given at a boundary without sides, such as a point."""
    for boundary, on_lattice in zip(layout.boundaries.definitions, layout.boundaries.on_lattice, strict=True):
        conditions = map(boundary.condition, SIDES)
        kinds = {condition.kind for condition in conditions if not isinstance(condition.law, Value)}
        if on_lattice.has_sides or not kinds:
            continue
        raise SceneError(
            f"boundary {boundary.name!r}: a {' or '.join(sorted(kinds))} condition at a point of a surface, or a point "
            "or curve of a solid, has no effect, since its flux has no area to pass; for a point source use the "
            "Galerkin form and f = PointSource(at, strength), else use a small circle or tube."
        )


def _check_same_place(layout: Layout) -> None:
    """Raise SceneError if two boundaries at the same place have different conditions."""
    for pair in layout.parallel_pairs:
        first, second = (layout.boundaries.definitions[number] for number in pair.numbers)
        sides = zip(SIDES, SIDES[::-1] if pair.reversed else SIDES, strict=True)
        if pair.same_place and not all(same_condition(first.condition(a), second.condition(b)) for a, b in sides):
            where = place(layout.lattice.to_scene(pair.point[None])[0])
            raise SceneError(
                f"boundaries {first.name!r} and {second.name!r} lie at the same place, near {where}, and "
                "hold different conditions; keep one of them, with `left` and `right` where its sides differ."
            )


def _check_conductivities(scene: Scene, layout: Layout) -> None:
    """Raise SceneError if a conductivity of a transmission differs from the problem's diffusivity beside it."""
    diffusivity = scene.problem.terms().diffusivity
    for boundary, view in zip(scene.boundaries, layout.boundaries.side_views, strict=True):
        law = boundary.condition("left").law
        if isinstance(law, Interface):
            check_conductivities(f"boundary {boundary.name!r}", law, diffusivity, view, layout.lattice)


def _check_coupled_beside_rims(layout: Layout) -> None:
    """Raise ResolutionError if a boundary with coupled sides runs less than a spacing from a rim of the manifold."""
    band, spacing = layout.band, layout.lattice.spacing
    if layout.surface.largest_dim == layout.surface.dim:  # nodes outside a solid read its edge on their own
        return
    for boundary, view in zip(layout.boundaries.definitions, layout.boundaries.side_views, strict=True):
        if boundary.condition("left").couples:
            near = view.take((view.distance < STRIP_SPACINGS * spacing) & (band.feet.edge[view.rows] >= 0))
            outward = unit(band.positions[near.rows] - band.feet.points[near.rows])
            beside = near.take(np.abs(dots(outward, near.conormal)) > ALONGSIDE_COSINE)
            if len(beside.rows):
                width, where = beside.distance.min(), place(layout.lattice.to_scene(beside.foot[:1])[0])
                raise ResolutionError(
                    f"spacing={spacing:g} is too coarse for boundary {boundary.name!r}, whose sides are coupled: near "
                    f"{where} it runs {width:.3g} from the manifold's rim; use {width / 3:.2g} or less."
                )


def _check_edges(scene: Scene, layout: Layout) -> None:
    """Raise SceneError if a condition is given for a loop of the edge, or an edge, that has no nodes past it."""
    resolved = np.unique(layout.band.feet.edge[layout.band.feet.edge >= 0]).tolist()
    if isinstance(scene.edge, Mapping):
        loops = {whole(loop, "a key of `edge`, the number of a loop,") for loop in scene.edge}
        missing = sorted(loops - set(resolved))
        given = f"`edge` gives a condition for loop {missing[0]}, and the manifold has no such loop" if missing else ""
    else:
        no_flux = all(condition.law.is_zero_flux for condition in scene.edge_conditions)
        missing, given = ([] if resolved or no_flux else [0]), "`edge` is given, and the manifold has no edge"
    if not missing:
        return
    spacing = layout.lattice.spacing
    loops_named = f"its loops are {', '.join(map(str, resolved))}" if resolved else "it is closed"
    raise SceneError(
        f"{given} at spacing={spacing:g}: {loops_named} as far as nodes lie past its edge; leave it out, correct the "
        "number, or use a smaller spacing if the edge is only a few spacings long."
    )


# Waves. A has complex eigenvalues: their imaginary parts are a few percent of the largest eigenvalues for degrees 3 and
# 5, ten times as much for degrees 2 and 4. In an undamped scheme such waves grow. Therefore leapfrog is damped, and the
# implicit scheme damps the waves that its step does not resolve.


def check_waves(scene: Scene, layout: Layout) -> None:
    """Raise InputError if a wave problem uses leapfrog with an even degree, under which waves grow without bound.

    Raises ResolutionError if the step is too long for leapfrog, or too short for the implicit scheme.
    """
    if not isinstance(scene.problem, Wave):
        return
    wave = scene.problem.with_scheme(explicit_steps=True)
    degree, spacing, dim = layout.band.degree, layout.lattice.spacing, layout.lattice.dim
    shortest = IMPLICIT_LEAST_SPACINGS * spacing / wave.speed
    longest = LEAPFROG_MOST_SPACINGS * spacing / (wave.speed * math.sqrt(dim))
    if wave.scheme == "implicit" and wave.step < shortest:
        raise ResolutionError(
            f"step={wave.step:g} is too short for the implicit scheme, which would not damp the waves that the spacing "
            f"does not resolve, and they grow; use at least {shortest:.3g}, or scheme 'leapfrog'."
        )
    if wave.scheme == "leapfrog" and degree % 2 == 0:
        raise InputError(
            f"degree={degree} does not go with leapfrog: interpolation of even degree gives the operator complex "
            "eigenvalues, under which waves grow without bound; use degree 3, or scheme 'implicit'."
        )
    if wave.scheme == "leapfrog" and min(wave.step, wave.duration) > longest:
        raise ResolutionError(
            f"step={wave.step:g} is too long for leapfrog at spacing={spacing:g}; use at most {longest:.3g}, or scheme "
            "'implicit'."
        )


#: Normals that turn by more than this (radians) over one spacing are a sharp bend: on a radius of 3 spacings the
#: solution is off by half a percent of its range.
SHARP_TURN_RADIANS = 1 / 3
#: A warning is given if this share of the pairs of neighbours has sharp turns, or of the stencils reads another sheet.
SHARP_SHARE = 5e-3
#: Neighbours whose normals have a smaller cosine than this are on different sheets or flanks; feet of neighbours
#: farther apart than this many spacings do not determine the curvature between them.
SAME_FLANK_COSINE, MOST_CHORD_SPACINGS = 0.2, 2.0
#: A boundary farther off the surface than this many spacings is probably a mistake.
OFF_SURFACE_SPACINGS = 0.5


def form_choice_warnings(scene: Scene, options: Options[CollocationOptions]) -> list[str]:
    """Return a warning in a list if this form solves a solid with boundaries inside since the other form refuses it."""
    text = f"The form 'collocation' solves this scene, since {options.reason}: errors near boundaries inside the solid "
    inside = scene.boundaries and largest_dim(scene.surface) == scene.surface.dim and "takes" in options.reason
    return [f"{text}fall with the square of the spacing at best."] if inside else []


def layout_warnings(layout: Layout, scene: Scene) -> tuple[str, ...]:
    """Return the warnings about a layout: its manifold, lattice, bends, sheets and boundaries."""
    spacing = layout.lattice.spacing
    advice = advice_of(layout.surface.source, spacing)
    pairs = zip(layout.boundaries.definitions, layout.boundaries.on_lattice, strict=True)
    cutting = [boundary.name for boundary, on_lattice in pairs if on_lattice.has_sides]
    return (
        *advice.warnings,
        *advice.closest_point_warnings,
        *layout.lattice.rounding_warnings(layout.surface.bounds, not layout.surface.shift.any()),
        *_snapped_boundary_warnings(layout),
        *geometry_warnings(layout, spacing),
        *small_boundary_warnings(scene, cutting, spacing, spacing),
    )


def geometry_warnings(layout: Layout, spacing: float) -> list[str]:
    """Return the warnings about bends, sheets and boundaries side by side of a ``layout``, for a solve at ``spacing``.

    ``spacing`` is smaller than that of the layout if the layout is the coarser one of a dry run.
    """
    # near a crease another sheet may be the other flank
    warnings = sharp_bend_warnings(layout, spacing) or _mixed_sheet_warnings(layout)
    for pair in layout.parallel_pairs:
        named = " and ".join(repr(layout.boundaries.definitions[number].name) for number in pair.numbers)
        where = f"near {place(layout.lattice.to_scene(pair.point[None])[0])}"
        if pair.same_place:
            same = f"Boundaries {named} lie at the same place, {where}, and hold the same"
            warnings.append(f"{same}; one of them is enough.")
        elif pair.width < STRIP_SPACINGS * spacing:
            warnings.append(
                f"Boundaries {named} run side by side, {pair.width / spacing:.2g} spacings apart {where}: the strip "
                f"between them shows a mixture of their values; a spacing of {pair.width / 3:.2g} would resolve it."
            )
    return warnings


def sharp_bend_warnings(layout: Layout, spacing: float) -> list[str]:
    """Return a list with a warning if a hypersurface has creases or bends too sharply for ``spacing``, or [].

    The warning is given if the normal turns by over 1/3 radian per spacing between at least 0.5 percent of the pairs of
    neighbours whose normals can be compared. Other manifolds are not examined.
    """
    if layout.surface.manifold_dim != layout.surface.dim - 1:
        return []
    band, directions = layout.band, foot_directions(layout.band)
    first, second = band.neighbour_pairs()
    chord = norms(band.feet.points[first] - band.feet.points[second])
    cosine = dots(directions.unit[first], directions.unit[second])
    comparable = directions.reliable[first] & directions.reliable[second] & (cosine > SAME_FLANK_COSINE)
    rows = np.flatnonzero(comparable & (chord < MOST_CHORD_SPACINGS * band.spacing))
    # the turn of the normal over the distance of the feet, or over a spacing where they are nearer, as at a crease
    curvature = np.arccos(np.minimum(cosine[rows], 1.0)) / np.maximum(chord[rows], band.spacing)
    sharp = curvature * spacing > SHARP_TURN_RADIANS
    if not len(sharp) or sharp.mean() < SHARP_SHARE:
        return []
    worst = layout.lattice.to_scene(band.feet.points[[first[rows[curvature.argmax()]]]])[0]
    resolved = SHARP_TURN_RADIANS / float(np.quantile(curvature[sharp], 0.9))
    return [
        f"Part of the surface bends more sharply than the band is wide, {sharp.mean():.1%} of it, most near "
        f'{place(worst)}: beside bends and creases the solution is less exact; use form="galerkin", or, for bends, a '
        f"spacing of {resolved:.2g}."
    ]


def _mixed_sheet_warnings(layout: Layout) -> list[str]:
    """Return a list with a warning if over 0.5 percent of the stencils read nodes of another sheet, or []."""
    sheets, band = layout.band.sheets, layout.band
    if sheets is None or len(sheets.mixed) <= SHARP_SHARE * band.inner:
        return []
    where = place(layout.lattice.to_scene(band.feet.points[sheets.mixed[:1]])[0])
    return [
        "In places stencils read nodes of a sheet that is not theirs, because no foot on their own was found; a "
        f"smaller spacing narrows the band. These are {len(sheets.mixed) / len(band.nodes):.1%} of the stencils, for "
        f"one near {where}."
    ]


def _snapped_boundary_warnings(layout: Layout) -> list[str]:
    """Return a warning for each boundary that is more than half a spacing off the surface."""
    spacing = layout.lattice.spacing
    return [
        f"Boundary {boundary.name!r} lies up to {on_lattice.gap:.3g} off the surface, {on_lattice.gap / spacing:.2g} "
        "spacings; it was snapped to the closest points."
        for boundary, on_lattice in zip(layout.boundaries.definitions, layout.boundaries.on_lattice, strict=True)
        if on_lattice.gap > OFF_SURFACE_SPACINGS * spacing
    ]
