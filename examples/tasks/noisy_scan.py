"""The Poisson equation on a noisy scan: points without triangles and without normals."""

import cpmkit as ck

scan = ck.source("pointcloud.points", file="scan.xyz", neighbours=40)
solution = ck.solve(ck.Scene(scan, ck.Poisson("x*y")), spacing=0.06)
solution.picture("scan.png", isolines=8, width=700)
