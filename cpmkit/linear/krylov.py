"""Conjugate gradients with a preconditioner, all channels in lockstep, each with its own scalars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.linear.direct import Indefinite
from cpmkit.protocols import Floats, Progress

Map = Callable[[Floats], Floats]


def conjugate_gradients(
    apply: Map, precondition: Map, residual: Floats, target: Floats, most: int, progress: Progress, slack: float = 1.0
) -> tuple[Floats, int]:
    """Return x (n, channels), about the solution of ``A x = residual``, and the iterations that it took.

    A channel is done where ``|r|`` is below its ``target`` (channels,) and ``(r, M r)^(1/2)``, which sees what large
    entries of A hide, has fallen by as much, ``slack`` times; or after ``most`` iterations.

    Raises
    ------
    Indefinite
        If A or the preconditioner M turns out to be so.
    """
    r = residual.copy()
    x, direction, before = np.zeros_like(r), np.zeros_like(r), np.ones(r.shape[1])
    shares = target / slack / np.sqrt(_dots(r, r))
    first = start = None
    for iteration in range(most + 1):
        z = precondition(r)
        energy, size = _dots(r, z), np.sqrt(_dots(r, r))
        first = energy if first is None else first
        behind = np.maximum(size / target, np.sqrt(np.abs(energy / first)) / shares)
        todo = (size > 0) & ~(behind <= 1)
        if (todo & ~(energy > 0)).any():
            raise Indefinite("what preconditions it has eigenvalues of the wrong sign")
        start = behind.max() if start is None else start
        progress("solve", float(np.clip(1 - np.log(behind.max()) / np.log(max(start, 2.0)), 0, 1)))
        if not todo.any() or iteration == most:
            break
        direction = z + np.where(todo, energy / before, 0.0) * direction
        image = apply(direction)
        bend = _dots(direction, image)
        if (todo & ~(bend > 0)).any():
            raise Indefinite("it has eigenvalues of the wrong sign")
        alpha = np.divide(energy, bend, out=np.zeros_like(energy), where=todo)
        x += alpha * direction
        r -= alpha * image
        before = np.where(energy > 0, energy, 1.0)
    return x, iteration


def _dots(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nc,nc->c", a, b))


def minimal_residuals(
    apply: Callable[[Any], Any],
    precondition: Callable[[Any], Any],
    residual: Any,
    target: Floats,
    most: int,
    progress: Progress,
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
