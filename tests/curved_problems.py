"""Manufactured solutions on a sphere and a torus: fluxes and their divergence by central differences of order six.

What is differentiated is made constant along normals first, so that derivatives along the axes are tangential ones.
"""

import numpy as np

STEP = 5e-3
SHARES = np.array([3 / 4, -3 / 20, 1 / 60])
TORUS_RADII = (1.0, 0.4)


def to_sphere(x):
    return x / np.linalg.norm(x, axis=1)[:, None]


def to_torus(x):
    ring = np.column_stack([x[:, :2] / np.linalg.norm(x[:, :2], axis=1)[:, None], np.zeros(len(x))])
    return TORUS_RADII[0] * ring + TORUS_RADII[1] * to_sphere(x - TORUS_RADII[0] * ring)


def derivative(function, x, axis):
    """The derivative along an axis of what returns (n, ...) at points (n, d)."""
    step = STEP * np.eye(x.shape[1])[axis]
    return sum(share / STEP * (function(x + k * step) - function(x - k * step)) for k, share in enumerate(SHARES, 1))


class Manufactured:
    """Of u and a flux law: the flux (n, d), and minus its divergence.

    ``law(values, slopes, points)`` is the flux.
    """

    def __init__(self, project, u, law):
        self.u, self.project, self.law = (lambda x: u(project(x))), project, law

    def slopes(self, x):
        return np.stack([derivative(self.u, self.project(x), axis) for axis in range(x.shape[1])], axis=1)

    def flux(self, x):
        on = self.project(x)
        return self.law(self.u(on), self.slopes(on), on)

    def f(self, x):
        return -sum(derivative(self.flux, x, axis)[:, axis] for axis in range(x.shape[1]))


def tangent(project, x):
    """The projections (n, d, d) on tangents."""
    rows = np.stack([derivative(project, x, axis) for axis in range(x.shape[1])], axis=2)
    values, vectors = np.linalg.eigh(0.5 * (rows + rows.transpose(0, 2, 1)))
    return np.einsum("nik,njk->nij", vectors * (values > 0.3)[:, None, :], vectors)


def by_tensor(project, tensor):
    """The law of a tensor (n, d, d): its part between tangents."""

    def law(values, slopes, x):
        del values
        return np.einsum("nij,njk,nk->ni", tangent(project, x), tensor(x), slopes)

    return law


def tensor_on_sphere(matrix, w, u0=0.0):
    """``-div(A grad u)`` and the flux of u = w . x on the unit sphere, A a constant matrix (3, 3), in closed form.

    With G = A P w and P = I - x x', the flux is P G, and div(P G) = tr(P DG) - 2 G . x.
    """

    def u(x):
        return x @ w + u0

    def flux(x):
        G = w @ matrix - (x @ w)[:, None] * (x @ matrix)
        return G - x * np.sum(G * x, axis=1)[:, None]

    def f(x):
        Ax, along = x @ matrix, x @ w
        xAx, xAw = np.sum(x * Ax, axis=1), Ax @ w
        return (xAw - along * xAx) + along * (np.trace(matrix) - xAx) + 2 * (xAw - along * xAx)

    return u, f, flux
