"""The mesh of a manifold for quadrature: its own cells repaired, or a contoured mesh."""

from __future__ import annotations

from dataclasses import replace

from cpmkit.manifold.local_source import LocalSource, measure_noise
from cpmkit.mesh.cell_quadrature import PLAIN_EDGE_SPACINGS
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.meshing.contouring.contoured_curves import contour_curve
from cpmkit.meshing.contouring.contoured_surfaces import contour_surface
from cpmkit.meshing.mesh_cache import repair_source_mesh
from cpmkit.meshing.mesh_warnings import (
    contouring_warnings,
    noise_warnings,
    repair_warnings,
    replace_spacing_advice,
    tracing_warnings,
)
from cpmkit.meshing.source_cells import source_cells


def mesh_of_manifold(
    surface: LocalSource, spacing: float, longest: float
) -> tuple[LocalSource, Mesh, CellGeometry, tuple[str, ...]]:
    """Return the manifold, its own mesh repaired or else a contoured one, the geometry of the cells, and warnings.

    ``longest`` is the largest edge length of curved cells, in spacings. A manifold that is known by closest points
    alone is returned with the measured noise of closest points, and with the flag of slight creases.
    """
    source_mesh = source_cells(surface, spacing * longest, spacing * PLAIN_EDGE_SPACINGS)
    if source_mesh is None or source_mesh.geometry == "closest_point":
        surface = surface.smooth_surface()
    if source_mesh is not None:
        mesh, repairs = repair_source_mesh(surface, source_mesh.mesh, source_mesh.split)
        return surface, mesh, source_mesh.geometry, tuple(repair_warnings(repairs, source_mesh.geometry))
    surface = measure_noise(surface, spacing)
    warnings = tuple(noise_warnings(surface, spacing))
    if surface.manifold_dim == 1:
        mesh, trace_defects = contour_curve(surface, spacing)
        contouring = tracing_warnings(trace_defects, surface)
    else:
        mesh, surface_report = contour_surface(surface, spacing)
        surface = replace(surface, slight_creases=surface_report.slight_creases)
        contouring = contouring_warnings(surface_report, surface)
    return surface, mesh, "closest_point", warnings + replace_spacing_advice(contouring, surface, spacing)
