"""Heat that spreads over Spot the cow, as a film."""

import cpmkit as ck

spot = ck.source("mesh.triangles", file="spot.obj")
heat = ck.Heat("exp(-40*(x**2 + (y - 0.9)**2 + (z + 0.6)**2))", until=0.3, step=0.01, frames=15)
solution = ck.solve(ck.Scene(spot, heat), spacing=0.06)
solution.animate("heat.gif", view=(-1, 0.4, -0.8), width=300, clim=(0, 0.1))
