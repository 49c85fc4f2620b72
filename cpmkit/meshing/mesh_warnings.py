"""Warnings on the mesh of a scene: repairs, contouring, noise, and the insertion of boundaries, each with a place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cpmkit.errors import place
from cpmkit.grid.lattice import round_up
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.adjacency import RepairReport
from cpmkit.mesh.mesh import CellGeometry
from cpmkit.meshing.contouring.contour_checks import MeshDefects
from cpmkit.meshing.contouring.contoured_curves import TraceDefects
from cpmkit.meshing.contouring.contoured_surfaces import MAX_NONMANIFOLD_SHARE, SurfaceReport
from cpmkit.meshing.insertion.boundary_insertion import Insertion
from cpmkit.types import Floats

#: Noise of closest points that is a larger share of the spacing than this causes a warning,
NOISE_SHARE = 1e-3
#: with this advice.
EXACTER = "compute closest points more exactly"
#: The error of noise is this factor times the noise over the spacing, as a share of the range of u (measured on spheres
#: and curves: .15 to .4).
NOISE_FACTOR = 0.4


def _cells_and_cure(geometry: CellGeometry, cure: str) -> tuple[str, str]:
    """Return the name of the cells in messages, and an advice: ``cure`` for the user's mesh, else a smaller spacing."""
    return ("triangulation of the surface", "use a smaller spacing") if geometry == "closest_point" else ("mesh", cure)


def repair_warnings(report: RepairReport, geometry: CellGeometry) -> Iterator[str]:
    """Yield warnings on removed cells and separated vertices, of the user's mesh or (``geometry``) a contoured one."""
    if report.doubled:
        cells, cure = _cells_and_cure(geometry, "clean the mesh")
        yield (
            f"{report.doubled} cells of the {cells} had the corners of another, or none of their own, and were left "
            f"out; {cure} if they were meant."
        )
    if report.fans:
        cells, cure = _cells_and_cure(geometry, "join them by an edge")
        yield (
            f"Parts of the {cells} touch at {report.fans} vertices that no edge joins there: nothing flows through "
            f"these; {cure} if it should."
        )


def seam_warnings(places: Floats, surface: LocalSource, geometry: CellGeometry) -> Iterator[str]:
    """Yield a warning if edges of rims lie on other rims; ``places`` (k, d) are relative to the lattice's origin."""
    if len(places):
        yield (
            f"{len(places)} edges of rims lie on other rims, the first near {_place_in_scene(places[0], surface)}: "
            "nothing flows across them; "
            f"{_cells_and_cure(geometry, 'weld the vertices of the mesh there')[1]} if it should."
        )


def contouring_warnings(report: SurfaceReport, surface: LocalSource) -> Iterator[str]:
    """Yield warnings on the triangulation of ``surface`` by its closest points, from its ``report``."""
    if report.nonmanifold_share > MAX_NONMANIFOLD_SHARE:
        yield (
            f"{report.nonmanifold_share:.0%} of the edges of the triangulation by closest points have three triangles "
            f"or more, at {report.lattice_spacing:g} spacings: the surface is thin there, or its sheets meet; "
            "use a smaller spacing to see which."
        )
    yield from _defect_warnings(report.defects, surface)
    if report.isolated_components:
        yield (
            f"{report.isolated_components} pieces of the triangulation by closest points with less area than a tenth "
            "of a square of the spacing were left out: the surface is thin, or has parts that the lattice does not "
            "see; use a smaller spacing."
        )
    if len(report.missed):
        yield (
            f"A piece of the surface near {_place_in_scene(report.missed[0], surface)} is too small for the lattice, "
            "and was left out; use a smaller spacing."
        )


def noise_warnings(source: LocalSource, spacing: float) -> Iterator[str]:
    """Yield a warning if the noise of ``source`` is above ``NOISE_SHARE`` of the lattice's ``spacing``."""
    if source.noise > NOISE_SHARE * spacing:
        yield (
            f"Closest points of this source are uncertain by about {source.noise:.2g}: points of one normal have other "
            f"feet. That leaves an error of about {NOISE_FACTOR * source.noise / spacing:.1g} of the range of u, and "
            f"more at smaller spacings; take none below {round_up(200.0 * source.noise):g}, or {EXACTER}."
        )


def replace_spacing_advice(texts: Iterator[str], source: LocalSource, spacing: float) -> tuple[str, ...]:
    """Return ``texts``; if ``source`` is noisy at ``spacing``, "use a smaller spacing" is replaced by :data:`EXACTER`.

    A smaller spacing would increase the error by noise.
    """
    noisy = source.noise > NOISE_SHARE * spacing
    return tuple(text.replace("use a smaller spacing", EXACTER) if noisy else text for text in texts)


def _defect_warnings(defects: MeshDefects, surface: LocalSource) -> Iterator[str]:
    """Yield warnings on the ``defects`` of a triangulation, with places in the scene's coordinates."""

    def first(places: Floats) -> str:
        """Return the text about the first of ``places`` (k, d)."""
        return f"the first near {_place_in_scene(places[0], surface)}"

    cells = "the triangulation by closest points"
    if len(defects.cracks):
        yield (
            f"{len(defects.cracks)} edges of {cells} are open where the surface has no rim, {first(defects.cracks)}: "
            "cracks through which nothing flows; use a smaller spacing."
        )
    knots = np.concatenate([defects.nonmanifold_edges, defects.branch_ends])
    if len(knots):
        yield f"Sheets of {cells} hang together wrongly at {len(knots)} places, {first(knots)}; use a smaller spacing."
    if len(defects.folds):
        words = f"triangles fold over beside a rim of the surface, {first(defects.folds)}"
        yield f"{len(defects.folds)} {words}; use a smaller spacing."
    if len(defects.uncovered):
        yield (
            f"{cells.capitalize()} leaves the surface at {len(defects.uncovered)} places of creases or rims, "
            f"{first(defects.uncovered)}: sharp edges or corners may be cut; use a smaller spacing."
        )
    if defects.component_change or defects.wrong_area:
        yield (
            f"The triangulation by closest points has an area {defects.area_error:+.0%} off a sum over lattice nodes, "
            f"and {abs(defects.component_change)} pieces came or went at rims; use a smaller spacing."
        )


def tracing_warnings(broken: TraceDefects, curve: LocalSource) -> Iterator[str]:
    """Yield warnings on defects of the trace of a curve by its closest points."""
    if len(broken.gaps):
        yield (
            f"The trace of the curve by closest points has loose ends at {len(broken.gaps)} places where the curve has "
            f"none, the first near {_place_in_scene(broken.gaps[0], curve)}: nothing flows there; use a smaller "
            "spacing."
        )
    if len(broken.missed):
        farthest = int(broken.missed_distances.argmax())
        yield (
            f"A piece of the curve near {_place_in_scene(broken.missed[farthest], curve)}, "
            f"{broken.missed_distances[farthest]:.2g} from the rest, is too small for the lattice, or was missed, "
            "and was left out; use a smaller spacing."
        )
    if len(broken.covered_twice):
        yield (
            f"The trace of the curve by closest points covers it twice at {len(broken.covered_twice)} places, the "
            f"first near {_place_in_scene(broken.covered_twice[0], curve)}: strands of the curve are too near to each "
            "other there; use a smaller spacing."
        )


def _place_in_scene(point: Floats, source: LocalSource) -> str:
    """Return the text of a ``point`` (d,), given relative to the lattice's origin, in the scene's coordinates."""
    return place(point + source.scene_origin)


def insertion_warnings(insertion: Insertion, names: Sequence[str], spacing: float) -> Iterator[str]:
    """Yield warnings on the insertion of boundaries, ``names`` in their order; ``spacing`` is the lattice's."""
    for number, other in sorted(insertion.coincident):
        if number in insertion.empty:
            yield (
                f"Boundaries {names[other]!r} and {names[number]!r} lie at the same place and hold "
                "the same; one of them is enough."
            )
    for number, gap in insertion.max_distances.items():
        if gap > 0.5 * spacing:
            yield (
                f"Boundary {names[number]!r} lies up to {gap:.3g} off the surface, {gap / spacing:.2g} "
                "spacings; it was snapped to the closest points."
            )
    counts = insertion.counts
    if counts.get("disconnected"):
        yield (
            f"{counts['disconnected']} pieces of boundaries do not hang together on the manifold, and were laid piece "
            "by piece: where they leave the manifold nothing holds."
        )
    if counts.get("joined"):
        yield f"{counts['joined']} open ends of boundaries lay beside a boundary or rim, and were joined to it."
