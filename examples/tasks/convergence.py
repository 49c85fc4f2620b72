"""Errors of closest points and of finite elements on one sphere, where u = x y is the solution."""

import numpy as np

import cpmkit as ck

sphere = ck.source("analytic.sphere")
scene = ck.Scene(sphere, ck.ScreenedPoisson("7*x*y"))
points = sphere.closest_point(np.random.default_rng(0).normal(size=(1000, 3))).points
for spacing in (0.4, 0.2, 0.1):
    for name, backend in (("splines", "cpm"), ("finite elements", "fem")):
        error = ck.solve(scene, spacing, backend=backend).evaluate(points) - points[:, 0] * points[:, 1]
        print(f"{name}, spacing {spacing}: {np.abs(error).max():.1e}")
