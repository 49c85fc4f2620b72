"""Diffusion curves on your own OBJ file, along a line that you drew on it."""

import cpmkit as ck
from cpmkit.applications import diffusion_curves

model = ck.source("mesh.triangles", file="model.obj")
line = ck.source("mesh.polyline", file="line.csv")
colours = {"left": ["gold", "tomato", "gold"], "right": ["teal", "navy", "teal"]}
painted = diffusion_curves(model, {"line": (line, colours)}, spacing=0.05)
painted.picture("painted.png", view=(-1, 0.4, -0.5), width=700)
