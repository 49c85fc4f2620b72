"""What a user writes, as a type checker reads it: all of it is right, and each line marked ``wrong`` is refused."""

import numpy as np

import cpmkit as ck
from cpmkit.applications import geodesic_distance

sphere = ck.source("analytic.sphere", radius=1.0)
equator = ck.source("analytic.circle", normal=[0, 0, 1])
cut = ck.Boundary("equator", equator, left=ck.Dirichlet(1.0), right=ck.Dirichlet("z"))
scene = ck.Scene(sphere, ck.Poisson("x*y"), [cut])

solution = ck.solve(scene, spacing=0.2, form="galerkin", degree=2, solver="direct", progress=False)
values = solution.evaluate(np.zeros((1, 3)), side={"equator": "left"})
print(values.mean(), solution.spacing, solution.flux("equator", "left"))

modes = ck.solve(ck.Scene(sphere, ck.Eigen(4)), 0.2)
print(modes.eigenvalues[0])
cooling = ck.solve(ck.Scene(sphere, ck.Heat("x", until=1.0, step=0.1, frames=2)), 0.2, checkpoint="run.npz")
print(cooling.time, cooling.frames[0].evaluate([[1, 0, 0]]))
elsewhere = ck.solve(scene, backend="fem")
print(elsewhere.mean())

prepared = ck.prepare(scene, 0.2, solver="direct")
again = prepared.solve(data={"equator": {"left": ck.Dirichlet(2.0)}}, guess=prepared.solve())
first = prepared.solve(problem=ck.Eigen(3)).eigenvalues[0]
print(again.report.solver, first, prepared.field(lambda x: x[:, 0]).values)
explanation = ck.explain(scene, spacing=0.2, order=2)
print(explanation.unknowns, ck.estimate_error(scene, 0.2).error)
loaded = ck.load_scene("scene.toml")
print(ck.solve(loaded.scene, loaded.spacing, **loaded.options).summary())
print(geodesic_distance(sphere, [[1.0, 0.0, 0.0]], spacing=0.2))

solution.picture("sphere.png", view=np.array([1.0, 0.0, 0.0]), up="z", isolines=[0.1, 0.2], light="shaded", clim=(0, 1))
solution.plot(cmap="magma", channel=0)
solution.show(title="A sphere", field="error")
solution.save("page.html", label="u", unit="K")
cooling.animate("film.gif", fps=5, width=200, curves=False)
cooling.save("film.gif", fps=5, edges=True)
line = ck.pick_line(solution, "line.csv", closed=True)
print(line.shape)

ck.nonexistent  # wrong
ck.Dirichlett(1)  # wrong
ck.solve(1, banana=1)  # wrong
ck.solve(scene, 0.2, banana=1)  # wrong
ck.solve(scene, 0.2, degree="two")  # wrong
ck.prepare(scene, 0.2, tolerance=1e-3)  # wrong
ck.explain(scene, spacing="0.2")  # wrong
ck.discretize(scene, 0.2, solver="direct")  # wrong
ck.Boundary("cut", equator, both=ck.Laplace())  # wrong
solution.eigenvalues  # wrong
solution.evaluat([[1, 0, 0]])  # wrong
solution.evaluate([[1, 0, 0]], side="lefft")  # wrong
modes.time  # wrong
prepared.solve(problem=ck.Laplace(), spacing=0.1)  # wrong
solution.picture("sphere.png", widht=300)  # wrong
solution.picture("sphere.png", light="bright")  # wrong
solution.plot(cmap=3)  # wrong
solution.show(titel="A sphere")  # wrong
solution.save("page.html", isoline=3)  # wrong
cooling.animate("film.gif", fsp=5)  # wrong
geodesic_distance(sphere, [[1.0, 0.0, 0.0]], spacing=0.2).picture("distance.png", isoline=3)  # wrong
