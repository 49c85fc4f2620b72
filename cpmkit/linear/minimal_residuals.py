"""Minimal residuals with a preconditioner (GMRES), all channels in lockstep; real or complex.

What it preconditions with may have eigenvalues of both signs, and so may A. Saad and Schultz, SIAM J. Sci. Stat.
Comput. 7 (1986), preconditioned from the right, so that the residual it minimises is that of the equations themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Progress

Map = Callable[[Any], Any]


def minimal_residuals(
    apply: Map, precondition: Map, residual: Any, target: Floats, most: int, progress: Progress
) -> tuple[Any, int]:
    """Return x (n, channels), about the solution of ``A x = residual``, and the iterations that it took.

    It stops where the residual of every channel is below its ``target`` (channels,), or after ``most`` iterations. One
    vector (n, channels) is kept for each iteration.
    """
    start = _norms(residual)
    basis = [_over(residual, start)]
    hessenberg = np.zeros((len(start), most + 1, most), dtype=residual.dtype)
    done, taken = start <= target, 0
    first = max(float(np.log(np.maximum(start / target, 2.0)).max()), 1e-300)
    while taken < most and not done.all():
        step = hessenberg[:, : taken + 2, taken]
        image = apply(precondition(basis[-1]))
        for _ in range(2):  # twice, against rounding
            for row, vector in enumerate(basis):
                share = np.einsum("nc,nc->c", vector.conj(), image)
                image = image - vector * share
                step[:, row] += share
        step[:, -1] = _norms(image)
        basis.append(_over(image, step[:, -1].real))
        taken += 1
        left = start * _least(hessenberg[:, : taken + 1, :taken])
        done |= left <= target
        progress("solve", float(np.clip(1 - np.log(np.maximum(left / target, 1.0)).max() / first, 0, 1)))
    if not taken:
        return np.zeros_like(residual), 0
    weights = np.linalg.pinv(hessenberg[:, : taken + 1, :taken])[:, :, 0] * start[:, None]
    return precondition(sum(vector * weights[:, row] for row, vector in enumerate(basis[:-1]))), taken


def _least(hessenberg: Any) -> Floats:
    """Return the least ``|e - H y|`` of any y, e the first unit vector, for each of the H (channels, k + 1, k)."""
    turned = np.linalg.qr(hessenberg, mode="complete").Q
    return np.asarray(np.abs(turned[:, 0, -1]))


def _norms(vectors: Any) -> Floats:
    return np.asarray(np.sqrt(np.einsum("nc,nc->c", vectors.conj(), vectors).real))


def _over(vectors: Any, norms: Floats) -> Any:
    """Return the vectors divided by their norms; those that are zero stay so, in a channel that is solved."""
    return vectors * np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
