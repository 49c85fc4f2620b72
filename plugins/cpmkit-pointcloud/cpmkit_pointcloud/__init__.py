"""Point clouds as closest point sources: blended local polynomials, or the nearest sample."""

from cpmkit_pointcloud import plugin
from cpmkit_pointcloud.cloud import OrientedPointCloud, PointCloud
from cpmkit_pointcloud.factory import points
from cpmkit_pointcloud.nearest import NearestSamples
from cpmkit_pointcloud.reading import read_points

__all__ = ["NearestSamples", "OrientedPointCloud", "PointCloud", "plugin", "points", "read_points"]
