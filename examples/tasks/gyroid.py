"""A gyroid inside a ball, with a flux through the edge where the ball cuts it."""

import cpmkit as ck

phi = "sin(x)*cos(y) + sin(y)*cos(z) + sin(z)*cos(x)"
bounds = [[-3.3] * 3, [3.3] * 3]
gyroid = ck.source("levelset.expression", phi=phi, bounds=bounds, trim="x**2 + y**2 + z**2 - 9")
solution = ck.solve(ck.Scene(gyroid, ck.ScreenedPoisson(0.0), edge=ck.Neumann("z/3")), spacing=0.12)
solution.picture("gyroid.png", width=700)
