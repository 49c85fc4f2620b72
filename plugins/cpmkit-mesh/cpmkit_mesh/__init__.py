"""Triangle meshes, polylines and curves of meshes as closest point sources, and lines drawn on surfaces by mouse."""

from cpmkit_mesh import plugin
from cpmkit_mesh.factory import triangles
from cpmkit_mesh.geodesic_path import path
from cpmkit_mesh.mesh_curves import edge_loop, feature_edges
from cpmkit_mesh.mesh_files import read_mesh
from cpmkit_mesh.obj import read_texture_coordinates
from cpmkit_mesh.polyline import Polyline, polyline
from cpmkit_mesh.triangles import TriangleMesh

__all__ = [
    "Polyline",
    "TriangleMesh",
    "edge_loop",
    "feature_edges",
    "path",
    "plugin",
    "polyline",
    "read_mesh",
    "read_texture_coordinates",
    "triangles",
]
