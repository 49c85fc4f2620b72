"""Conjugate gradients with a preconditioner, all channels in lockstep, each with its own scalars."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.linear.multigrid_exact import Indefinite
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
