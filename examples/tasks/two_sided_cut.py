"""A cut with a value on each side; both values at the mesh's own vertices, in a PLY file."""

import cpmkit as ck

spot = ck.source("mesh.triangles", file="spot.obj")
cut = ck.Boundary("cut", ck.source("mesh.polyline", file="line.csv"), left=1.0, right="-1 - x")
solution = ck.solve(ck.Scene(spot, ck.Laplace(), [cut]), spacing=0.06)
mesh = solution.to_meshio("own")
mesh.point_data = {"left": solution.at_vertices("left"), "right": solution.at_vertices("right")}
mesh.write("both.ply")
