"""Triangle meshes and polylines as closest point sources, by a float64 tree of our own."""

from cpmkit_mesh import plugin
from cpmkit_mesh.polyline import Polyline, polyline
from cpmkit_mesh.reading import read_mesh
from cpmkit_mesh.triangles import TriangleMesh, triangles

__all__ = ["Polyline", "TriangleMesh", "plugin", "polyline", "read_mesh", "triangles"]
