"""The library that finds the nearest triangle: the box tree of this plugin, python-fcl or Open3D.

The two others only name a triangle; the point on it is computed here in float64, so that the interpolation of normals
works with each of them. They are for comparison: both are slower, and Open3D now and then names a neighbour of the
nearest triangle.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, MissingDependencyError, thread_count
from cpmkit_mesh.box_tree import BoxTree, Nearest, find_nearest, project_onto_primitives

ENGINES = ("own", "fcl", "open3d")
#: Twice the area over the square of the longest edge below which a triangle makes fcl's answers for the mesh wrong.
SLIVER_SHARE_FOR_FCL = 1e-12
#: Packages of Debian whose name does not follow from that of their library.
DEBIAN_PACKAGES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libX11.so.6": "libx11-6"}

Search = Callable[[Floats], Nearest]


def nearest_search(engine: str, tree: BoxTree) -> Search:
    """Return a function from queries (n, 3) to their nearest points (``Nearest``) on the triangles of ``tree``.

    ``engine`` is one of :data:`ENGINES`; the triangles of "open3d" are nearest up to the rounding of float32. Raise
    MissingDependencyError if the library of the engine is absent or does not load; "fcl" raises InputError if the mesh
    has triangles without area, about which it answers wrongly.
    """
    if engine == "own":
        return partial(find_nearest, tree)
    slots = {"fcl": _fcl_search, "open3d": _open3d_search}[engine](tree)
    return lambda x: project_onto_primitives(tree, x, slots(x))


def _fcl_search(tree: BoxTree) -> Callable[[Floats], Ints]:
    """Return a function from queries (n, 3) to the slots (n,) of their nearest triangles, in float64, by a Python loop.

    Raise InputError if a triangle has no area, MissingDependencyError if python-fcl does not load.
    """
    fcl = _import_optional("fcl", "python-fcl")
    first, second = tree.frames[:, 1], tree.frames[:, 2]
    longest = np.max([np.sum(edge**2, axis=1) for edge in (first, second, second - first)], axis=0)
    flat = np.linalg.norm(np.cross(first, second), axis=1) <= SLIVER_SHARE_FOR_FCL * longest
    if flat.any():
        raise InputError(
            f"{int(flat.sum())} of {len(flat)} triangles have no area, and fcl answers wrongly about a mesh that has "
            "any; leave them out, or take engine = 'own'."
        )
    mesh = fcl.BVHModel()
    mesh.beginModel(3 * len(flat), len(flat))
    mesh.addSubModel(_corners(tree).reshape(-1, 3), np.arange(3 * len(flat)).reshape(-1, 3))
    mesh.endModel()
    about, point, request = fcl.CollisionObject(mesh), fcl.CollisionObject(fcl.Sphere(0.0)), fcl.DistanceRequest()

    def nearest_slot(query: Floats) -> int:
        point.setTranslation(query)
        result = fcl.DistanceResult()
        fcl.distance(point, about, request, result)
        return int(result.b1)

    return lambda x: np.array([nearest_slot(query) for query in x], dtype=np.int64)


def _open3d_search(tree: BoxTree) -> Callable[[Floats], Ints]:
    """Return a function from queries (n, 3) to slots (n,) of triangles nearest to them up to the rounding of float32.

    Coordinates are relative to the mesh's centre and size. Raise MissingDependencyError if Open3D does not load.
    """
    open3d = _import_optional("open3d", "open3d")
    corners = _corners(tree).reshape(-1, 3)
    middle, size = 0.5 * (corners.min(axis=0) + corners.max(axis=0)), np.ptp(corners, axis=0).max()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        ((corners - middle) / size).astype(np.float32), np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    )

    def nearest_slots(x: Floats) -> Ints:
        if not len(x):
            return np.zeros(0, dtype=np.int64)
        answer = scene.compute_closest_points(((x - middle) / size).astype(np.float32), nthreads=thread_count())
        return answer["primitive_ids"].numpy().astype(np.int64)

    return nearest_slots


def _corners(tree: BoxTree) -> Floats:
    """Return the corners (m, 3, 3) of the triangle in each slot."""
    corners = tree.frames.copy()
    corners[:, 1:] += corners[:, :1]
    return corners


def _import_optional(module: str, distribution: str) -> Any:
    """Return the imported ``module``; raise MissingDependencyError if it, or a package that it needs, does not load.

    ``distribution`` is the name under which pip installs it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = distribution if error.name == module else error.name
        raise MissingDependencyError(
            f"engine = '{module}' needs the package {package}: `pip install {package}`, or take engine = 'own'."
        ) from error
    except (ImportError, OSError) as error:
        raise MissingDependencyError(_loading_error(distribution, str(error))) from error


def _loading_error(distribution: str, message: str) -> str:
    """Return the error sentence for an installed ``distribution`` that does not load, from the loader's ``message``."""
    library = re.search(r"(lib[\w.+-]+?\.so(?:\.\d+)*): cannot open shared object file", message)
    if library is None:
        return f"{distribution} is installed but does not load: {message}; engine = 'own' needs no other library."
    name = library[1]
    package = DEBIAN_PACKAGES.get(name, name.replace(".so.", "-").lower())
    return (
        f"{distribution} is installed but cannot load the system library {name}; on Debian `apt-get install {package}` "
        "adds it, and engine = 'own' needs no other library."
    )
