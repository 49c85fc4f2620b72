"""Six modes of a tube around a torus knot, as a sheet of pictures."""

import cpmkit as ck

knot = ck.source("parametric.torus_knot", a=2, b=3)
tube = ck.source("tube", around=knot, radius=0.4)
modes = ck.solve(ck.Scene(tube, ck.Eigen(count=6)), spacing=0.12)
modes.picture("modes.png", width=900)
