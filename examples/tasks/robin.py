"""A source in one point of a cap whose edge lets heat out."""

import cpmkit as ck

cap = ck.source("analytic.cap", height=-0.3)
problem = ck.Poisson(ck.PointSource([0.6, 0.0, 0.8]))
solution = ck.solve(ck.Scene(cap, problem, edge=ck.Robin(1.0, 2.0)), spacing=0.08)
solution.picture("robin.png", isolines=12, clim=(0, 0.5), width=700)
