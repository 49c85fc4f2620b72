"""What ties the components of a field of vectors to each other, so that it stays tangential and goes on in parallel."""

from __future__ import annotations

import numpy as np

import cpmkit as ck
from cpmkit.plugin import unit
from cpmkit.preparing import Prepared
from cpmkit.protocols import Floats

#: s: with 1 the directions are 18 times less exact on a sphere, with 100 iterations are twice as many.
TANGENTIAL_STRENGTH = 25.0


def tangential_coupling(prepared: Prepared, parallel: bool) -> ck.Field:
    """Return (s / h^2) n n', less S^2 where vectors are transported in parallel, as a field of nine channels."""
    normals = ck.normals_at(prepared.scene.surface, prepared.points)
    across = np.einsum("pi,pj->pij", normals, normals)
    found = TANGENTIAL_STRENGTH / prepared.discretized.spacing**2 * across
    if parallel:
        shape = _shape_operator(prepared, across)
        found = found - np.einsum("pik,pjk->pij", shape, shape)
    return prepared.field(np.ascontiguousarray(found.reshape(-1, 9)))


def _shape_operator(prepared: Prepared, across: Floats) -> Floats:
    """Return S (p, 3, 3), of any sign, from n n' (p, 3, 3): with n . n = 1, grad(n n') n = grad n."""
    column = np.einsum("pii->pi", across).argmax(axis=1)
    normal = unit(across[np.arange(len(across)), :, column])
    found = np.zeros_like(across)
    for i in range(3):
        for j in range(3):
            found[:, i] += prepared.field(np.ascontiguousarray(across[:, i, j])).gradient().values * normal[:, j, None]
    return found
