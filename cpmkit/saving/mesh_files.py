"""Meshes with values at their vertices, in the formats of other programs."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.manifold.vector_algebra import in_three_dimensions
from cpmkit.runtime.messages import install_command
from cpmkit.runtime.options import check_one_of
from cpmkit.scenefile.look import VERTICES
from cpmkit.solution.display_mesh import DisplayMesh, given_mesh_of
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats
from cpmkit.view.colours import as_bytes, make_bar


def write_vtp(mesh: DisplayMesh, path: Path, error: Floats | None = None) -> None:
    """Write a .vtp file for ParaView: a mesh with its values and, if given, their estimated ``error`` (v, channels)."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    path.write_bytes(_vtk_bytes(vtkXMLPolyDataWriter(), poly_data(mesh, error)))


def write_vtu(mesh: DisplayMesh, path: Path, error: Floats | None = None) -> None:
    """Write a .vtu file for ParaView: an unstructured grid with the contents of :func:`write_vtp`."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    grid = poly_data(mesh, error).cast_to_unstructured_grid()
    path.write_bytes(_vtk_bytes(vtkXMLUnstructuredGridWriter(), grid))


def write_ply(mesh: DisplayMesh, path: Path, error: Floats | None = None) -> None:
    """Write a binary PLY file: vertices with values, ``error`` (v, channels) if given and colours; triangles alone."""
    columns = value_columns(mesh, error)
    names = ["x", "y", "z", *columns]
    colours = ("red", "green", "blue")
    kinds = [*((name, "<f8") for name in names), *((name, "u1") for name in colours)]
    points = np.zeros(len(mesh.points), dtype=kinds)
    for name, column in zip("xyz", in_three_dimensions(mesh.points).T, strict=True):
        points[name] = column
    for name, column in columns.items():
        points[name] = column
    for name, column in zip(colours, as_bytes(colours_of(mesh)).T, strict=True):
        points[name] = column
    faces = np.zeros(len(mesh.triangles), dtype=[("corners", "u1"), ("vertices", "<i4", 3)])
    faces["corners"], faces["vertices"] = 3, mesh.triangles
    header = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"),
        *(f"property double {name}" for name in names),
        *(f"property uchar {name}" for name in colours),
        *(f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"),
    ]
    path.write_bytes("".join(f"{line}\n" for line in header).encode() + points.tobytes() + faces.tobytes())


def write_obj(mesh: DisplayMesh, path: Path, _error: Floats | None = None) -> None:
    """Write an OBJ file: vertices with their colours, triangles and segments; values and error are left out."""
    rows = np.hstack([in_three_dimensions(mesh.points), colours_of(mesh)])
    lines = [f"v {x!r} {y!r} {z!r} {r:.4f} {g:.4f} {b:.4f}" for x, y, z, r, g, b in rows.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]
    lines += [f"l {a} {b}" for a, b in (mesh.segments + 1).tolist()]
    path.write_text("\n".join([*lines, ""]), encoding="ascii")


def write_csv(mesh: DisplayMesh, path: Path, error: Floats | None = None) -> None:
    """Write a CSV file with columns x, y, z (in space), u or u0, u1, ..., and if given ``error`` (v, channels)."""
    columns = value_columns(mesh, error)
    rows = np.column_stack([mesh.points, *columns.values()])
    names = ",".join([*"xyz"[: mesh.points.shape[1]], *columns])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    path.write_text("\n".join([names, *lines, ""]), encoding="ascii")


def write_npz(mesh: DisplayMesh, path: Path, _error: Floats | None = None) -> None:
    """Write a mesh as a compressed .npz file with the arrays ``points``, ``cells`` and ``values``, without error."""
    np.savez_compressed(path, points=mesh.points, cells=mesh.cells, values=mesh.values)


#: Writers of a mesh and the estimated error at its vertices, by suffix.
MESH_WRITERS: dict[str, Callable[[DisplayMesh, Path, Floats | None], None]] = {
    ".vtp": write_vtp,
    ".vtu": write_vtu,
    ".ply": write_ply,
    ".obj": write_obj,
    ".csv": write_csv,
    ".npz": write_npz,
}


def value_columns(mesh: DisplayMesh, error: Floats | None = None) -> dict[str, Floats]:
    """Return the columns (v,) of a mesh's values by name, ``u`` or ``u0``, ``u1``, ..., and of ``error`` likewise."""
    named = {"u": mesh.values} | ({} if error is None else {"error": error})
    return {
        name if array.shape[1] == 1 else f"{name}{channel}": array[:, channel]
        for name, array in named.items()
        for channel in range(array.shape[1])
    }


def colours_of(mesh: DisplayMesh) -> Floats:
    """Return colours (v, 3), from 0 to 1: three channels, or else the first in viridis; grey where not finite."""
    known = np.flatnonzero(np.isfinite(mesh.values).all(axis=1))
    colours = np.full((len(mesh.values), 3), 0.6)
    values = mesh.values[known]
    if len(values):
        colours[known] = np.clip(values, 0, 1) if values.shape[1] == 3 else make_bar(values[:, 0]).colours(values[:, 0])
    return colours


def poly_data(mesh: DisplayMesh, error: Floats | None = None) -> Any:
    """Return the mesh as a pyvista.PolyData with point data ``u`` and, where they apply, ``error`` and ``rgb``.

    Raises MissingDependencyError if pyvista is not installed, or a library of the system that it needs is absent.
    """
    try:
        import pyvista
    except ImportError as error_of_import:
        raise MissingDependencyError(
            f"pyvista, which holds meshes for VTK, does not import: {error_of_import}; "
            f"{install_command('view')} adds it."
        ) from error_of_import

    parts = {"faces": mesh.triangles, "lines": mesh.segments, "verts": mesh.dots[:, None]}
    listed: dict[str, Any] = {
        name: np.insert(part, 0, part.shape[1], axis=1).ravel() for name, part in parts.items() if len(part)
    }
    data = pyvista.PolyData(in_three_dimensions(mesh.points), **listed)
    for name, array in {"u": mesh.values, "error": error}.items():
        if array is not None:
            data.point_data[name] = array[:, 0] if array.shape[1] == 1 else array
    if mesh.values.shape[1] == 3:
        data.point_data["rgb"] = as_bytes(colours_of(mesh))
    if mesh.normals is not None:
        data.point_data.active_normals = mesh.normals
    return data


def _vtk_bytes(writer: Any, data: Any) -> bytes:
    """Return the contents of the file that a ``writer`` of VTK makes of the data set ``data``.

    VTK itself would leave half a file on a full disk without an error.
    """
    writer.SetInputData(data)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode()


def to_pyvista(solution: SolutionRecord, vertices: str = "display") -> Any:
    """Return the mesh, ``vertices`` "display" or "own", as ``pyvista.PolyData`` with ``u``; as :func:`poly_data`."""
    return poly_data(_chosen_mesh(solution, vertices))


def to_trimesh(solution: SolutionRecord, vertices: str = "display") -> Any:
    """Return a ``trimesh.Trimesh`` with colours and ``u``, or ``u0``, ...; see :meth:`cpmkit.Solution.to_trimesh`."""
    trimesh, mesh = _library_and_mesh("trimesh", solution, vertices)
    made = trimesh.Trimesh(in_three_dimensions(mesh.points), mesh.triangles, process=False)
    made.visual.vertex_colors = as_bytes(colours_of(mesh))
    made.vertex_attributes.update(value_columns(mesh))
    return made


def to_meshio(solution: SolutionRecord, vertices: str = "display") -> Any:
    """Return the mesh, ``vertices`` "display" or "own", with all its cells, as a ``meshio.Mesh`` with ``u``."""
    meshio, mesh = _library_and_mesh("meshio", solution, vertices)
    parts = {"triangle": mesh.triangles, "line": mesh.segments, "vertex": mesh.dots[:, None]}
    cells = [(kind, part) for kind, part in parts.items() if len(part)]
    values = mesh.values[:, 0] if mesh.values.shape[1] == 1 else mesh.values
    return meshio.Mesh(mesh.points, cells, point_data={"u": values})


def to_polyscope(solution: SolutionRecord, name: str = "solution", vertices: str = "display") -> Any:
    """Register the mesh ("display" or "own") with polyscope as ``name``, and return it; ``polyscope.show()`` draws."""
    polyscope, mesh = _library_and_mesh("polyscope", solution, vertices)
    polyscope.init()
    made = polyscope.register_surface_mesh(name, in_three_dimensions(mesh.points), mesh.triangles)
    for column, values in value_columns(mesh).items():
        made.add_scalar_quantity(column, values, enabled=mesh.values.shape[1] == 1)
    if mesh.values.shape[1] == 3:
        made.add_color_quantity("u", colours_of(mesh), enabled=True)
    return made


def _chosen_mesh(solution: SolutionRecord, vertices: str) -> DisplayMesh:
    """Return the display mesh for ``vertices`` "display", the surface's given mesh for "own"; else raise InputError."""
    check_one_of(vertices, VERTICES, "vertices")
    return own_mesh(solution) if vertices == "own" else solution.display_mesh()


def _library_and_mesh(name: str, solution: SolutionRecord, vertices: str) -> tuple[Any, DisplayMesh]:
    """Return the module of the library ``name``, and the mesh of :func:`_chosen_mesh` for it.

    Raises MissingDependencyError if the library is not installed, and InputError for another word in ``vertices``, or
    if the mesh has no triangles, which all but meshio need.
    """
    try:
        library = import_module(name)
    except ImportError as error:
        raise MissingDependencyError(f"{name} is not installed; `pip install {name}` adds it.") from error
    mesh = _chosen_mesh(solution, vertices)
    if not len(mesh.triangles) and name != "meshio":
        raise InputError(f"{name} takes triangles, and the mesh has none; use to_pyvista or to_meshio.")
    return library, mesh


def own_mesh(solution: SolutionRecord) -> DisplayMesh:
    """Return the mesh from which the surface was made, with the solution at its vertices; InputError if none."""
    vertices, cells = given_mesh_of(solution.scene.surface)
    values = solution.at_vertices(None).reshape(len(vertices), -1)
    return DisplayMesh(vertices, cells, values, None, len(vertices))
