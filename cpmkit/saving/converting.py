"""Solutions as meshes of other libraries, with the solution at the vertices."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.saving.export import own_mesh
from cpmkit.saving.mesh_files import colours_of, poly_data, value_columns
from cpmkit.scenefile.output_request import check_vertices
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.view.drawing import in_space

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord


def to_pyvista(solution: SolutionRecord, vertices: str = "display") -> Any:
    """Return a ``pyvista.PolyData`` with point data ``u``."""
    return poly_data(_mesh(solution, vertices))


def to_trimesh(solution: SolutionRecord, vertices: str = "display") -> Any:
    """Return a ``trimesh.Trimesh`` with vertex attributes ``u``, of several channels ``u0``, ..., and colours.

    Raises
    ------
    InputError
        If there are no triangles.
    """
    trimesh, mesh = _imported("trimesh"), _mesh(solution, vertices)
    _check_triangles(mesh, "trimesh")
    made = trimesh.Trimesh(in_space(mesh.points), mesh.triangles, process=False)
    made.visual.vertex_colors = np.round(255 * colours_of(mesh)).astype(np.uint8)
    made.vertex_attributes.update(value_columns(mesh))
    return made


def to_meshio(solution: SolutionRecord, vertices: str = "display") -> Any:
    """Return a ``meshio.Mesh`` of all cells with point data ``u``."""
    meshio, mesh = _imported("meshio"), _mesh(solution, vertices)
    parts = {"triangle": mesh.triangles, "line": mesh.segments, "vertex": mesh.dots[:, None]}
    cells = [(kind, part) for kind, part in parts.items() if len(part)]
    values = mesh.values[:, 0] if mesh.values.shape[1] == 1 else mesh.values
    return meshio.Mesh(mesh.points, cells, point_data={"u": values})


def to_polyscope(solution: SolutionRecord, name: str = "solution", vertices: str = "display") -> Any:
    """Register the mesh with polyscope, with its values as quantities, and return it; ``polyscope.show()`` draws.

    Raises
    ------
    InputError
        If there are no triangles.
    """
    polyscope, mesh = _imported("polyscope"), _mesh(solution, vertices)
    _check_triangles(mesh, "polyscope")
    polyscope.init()
    made = polyscope.register_surface_mesh(name, in_space(mesh.points), mesh.triangles)
    for column, values in value_columns(mesh).items():
        made.add_scalar_quantity(column, values, enabled=mesh.values.shape[1] == 1)
    if mesh.values.shape[1] == 3:
        made.add_color_quantity("u", colours_of(mesh), enabled=True)
    return made


def _mesh(solution: SolutionRecord, vertices: str) -> DisplayMesh:
    check_vertices(vertices)
    return own_mesh(solution) if vertices == "own" else solution.display_mesh()


def _check_triangles(mesh: DisplayMesh, name: str) -> None:
    if not len(mesh.triangles):
        raise InputError(f"{name} takes triangles, and the mesh has none; use to_pyvista or to_meshio.")


def _imported(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingDependencyError(f"{name} is not installed; `pip install {name}` adds it.") from error
