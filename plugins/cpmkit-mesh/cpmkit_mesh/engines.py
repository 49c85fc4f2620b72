"""Which library finds the nearest triangle: the own tree, or python-fcl or Open3D for whoever has them.

The others only name a triangle; the foot on it is computed here, in float64, so that the interpolation of normals sits
on top of each of them alike. They are for comparison: both are slower, and Open3D now and then names a neighbour
of the nearest triangle.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, MissingDependencyError, thread_count
from cpmkit_mesh.tree import Nearest, Tree, nearest, nearest_in

ENGINES = ("own", "fcl", "open3d")
#: Twice the area over the square of the longest edge, below which fcl's answers about a whole mesh are wrong.
SLIVER_SHARE_FOR_FCL = 1e-12
#: Packages of Debian whose name does not follow from that of their library.
DEBIAN_PACKAGES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libX11.so.6": "libx11-6"}

Search = Callable[[Floats], Nearest]


def search_with(engine: str, tree: Tree) -> Search:
    """Return what answers queries (n, 3) about the triangles of ``tree`` with the library ``engine``.

    Raises
    ------
    MissingDependencyError
        If the library is absent or does not load.
    InputError
        If it cannot answer for this mesh.
    """
    if engine == "own":
        return partial(nearest, tree)
    named = {"fcl": _fcl, "open3d": _open3d}[engine](tree)
    return lambda x: nearest_in(tree, x, named(x))


def _fcl(tree: Tree) -> Callable[[Floats], Ints]:
    """Return what names the nearest slot to each query, in float64, by a loop in Python."""
    fcl = _imported("fcl", "python-fcl")
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

    def name(query: Floats) -> int:
        point.setTranslation(query)
        result = fcl.DistanceResult()
        fcl.distance(point, about, request, result)
        return int(result.b1)

    return lambda x: np.array([name(query) for query in x], dtype=np.int64)


def _open3d(tree: Tree) -> Callable[[Floats], Ints]:
    """Return what names a slot near each query, in float32 about the middle of the mesh in units of its size."""
    open3d = _imported("open3d", "open3d")
    corners = _corners(tree).reshape(-1, 3)
    middle, size = 0.5 * (corners.min(axis=0) + corners.max(axis=0)), np.ptp(corners, axis=0).max()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        ((corners - middle) / size).astype(np.float32), np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    )

    def name(x: Floats) -> Ints:
        if not len(x):
            return np.zeros(0, dtype=np.int64)
        found = scene.compute_closest_points(((x - middle) / size).astype(np.float32), nthreads=thread_count())
        return found["primitive_ids"].numpy().astype(np.int64)

    return name


def _corners(tree: Tree) -> Floats:
    corners = tree.frames.copy()
    corners[:, 1:] += corners[:, :1]
    return corners


def _imported(module: str, distribution: str) -> Any:
    """Return an optional module, with one sentence for what it lacks."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = distribution if error.name == module else error.name
        raise MissingDependencyError(
            f"engine = '{module}' needs the package {package}: `pip install {package}`, or take engine = 'own'."
        ) from error
    except (ImportError, OSError) as error:
        raise MissingDependencyError(_unloadable(distribution, str(error))) from error


def _unloadable(distribution: str, message: str) -> str:
    library = re.search(r"(lib[\w.+-]+?\.so(?:\.\d+)*): cannot open shared object file", message)
    if library is None:
        return f"{distribution} is installed but does not load: {message}; engine = 'own' needs no other library."
    name = library[1]
    package = DEBIAN_PACKAGES.get(name, name.replace(".so.", "-").lower())
    return (
        f"{distribution} is installed but cannot load the system library {name}; on Debian `apt-get install {package}` "
        "adds it, and engine = 'own' needs no other library."
    )
