"""Krylov iterations on several channels at the same time, and their restarts from the true residual."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np

from cpmkit.linear.direct import IndefiniteError
from cpmkit.types import Floats, Progress

#: Function that returns a correction (n, k), its iterations and its products with A, from a residual (n, k), the norms
#: (k,) to which the residual is to fall, and the most iterations.
Correction = Callable[[Any, Floats, int], tuple[Any, int, int]]
#: End of the message of a solve that did not converge.
REMEDY = "ask for a larger solver_tolerance or more max_iterations, or use solver='direct'"


def solve_by_corrections(
    residual_of: Callable[[Any], Any],
    b: Any,
    guess: Any,
    tolerance: float,
    correct: Correction,
    *,
    max_iterations: int,
    target_share: float,
    rounds: int | None = None,
    round_iterations: int | None = None,
    first_slack: float = 1.0,
    stops_when_stalled: bool = False,
) -> tuple[Any, int, int]:
    """Return u (n, channels) with ``A u = b``, the iterations, and the number of products with A over all channels.

    Each round computes the true residual and corrects the channels in which it is above the tolerance.

    Parameters
    ----------
    residual_of : callable
        Returns ``b - A u`` (n, channels) for u.
    b : (n, channels)
        Right-hand sides.
    guess : (n, channels) or None
        The first u, zero if None.
    tolerance : float
        Relative residual that each channel has to reach.
    correct : Correction
        The Krylov iteration.
    max_iterations : int
        Most iterations of all rounds together.
    target_share : float
        Share of the tolerance that the iteration aims for, as its recursive residual drifts from the true residual.
    rounds : int, optional
        Most rounds.
    round_iterations : int, optional
        Most iterations of a round.
    first_slack : float
        In the first round a residual is accepted only if it is this many times smaller than the tolerance.
    stops_when_stalled : bool
        Whether to stop after a round that ended early without halving the residual of any channel.
    """
    size = np.linalg.norm(b, axis=0)
    u = np.zeros_like(b) if guess is None else guess.copy()
    u[:, size == 0] = 0.0  # the exact solution there, where no relative residual is defined
    iterations = products = 0
    ended_early, before = False, size
    for number in count() if rounds is None else range(rounds):
        residual = residual_of(u)
        norms = np.linalg.norm(residual, axis=0)
        if stops_when_stalled and ended_early and not np.any(norms < 0.5 * before):
            break
        products += b.shape[1]
        unsolved = np.flatnonzero(norms > (tolerance if number else tolerance / first_slack) * size)
        most = min(max_iterations - iterations, round_iterations or max_iterations)
        if not len(unsolved) or most <= 0:
            break
        target = target_share * tolerance * size[unsolved]
        step, taken, applied = correct(np.ascontiguousarray(residual[:, unsolved]), target, most)
        u[:, unsolved] += step
        iterations, products = iterations + taken, products + applied
        ended_early, before = taken < most, norms
    return u, iterations, products


def conjugate_gradients(
    apply: Callable[[Floats], Floats],
    precondition: Callable[[Floats], Floats],
    residual: Floats,
    target: Floats,
    most: int,
    progress: Progress,
    slack: float = 1.0,
) -> tuple[Floats, int]:
    """Return an approximate solution x (n, channels) of ``A x = residual``, and the iterations of conjugate gradients.

    A channel is finished when the norm of its residual r is below its ``target`` (channels,) and ``(r, M r)^(1/2)``, in
    which large entries of A do not hide the error, has fallen by the same factor times ``slack``. The iteration stops
    when all channels are finished, or after ``most`` iterations. ``apply`` returns products with A, ``precondition``
    with M.

    Raises
    ------
    IndefiniteError
        If A or the preconditioner M turns out to be indefinite.
    """
    r = residual.copy()
    x, direction, before = np.zeros_like(r), np.zeros_like(r), np.ones(r.shape[1])
    shares = target / slack / np.sqrt(_dots(r, r))
    first = start = None
    for iteration in range(most + 1):
        z = precondition(r)
        energy, size = _dots(r, z), np.sqrt(_dots(r, r))
        first = energy if first is None else first
        excess = np.maximum(size / target, np.sqrt(np.abs(energy / first)) / shares)
        unfinished = (size > 0) & ~(excess <= 1)
        if (unfinished & ~(energy > 0)).any():
            raise IndefiniteError("what preconditions it has eigenvalues of the wrong sign")
        start = excess.max() if start is None else start
        progress("solve", float(np.clip(1 - np.log(excess.max()) / np.log(max(start, 2.0)), 0, 1)))
        if not unfinished.any() or iteration == most:
            break
        direction = z + np.where(unfinished, energy / before, 0.0) * direction
        image = apply(direction)
        curvature = _dots(direction, image)
        if (unfinished & ~(curvature > 0)).any():
            raise IndefiniteError("it has eigenvalues of the wrong sign")
        alpha = np.divide(energy, curvature, out=np.zeros_like(energy), where=unfinished)
        x += alpha * direction
        r -= alpha * image
        before = np.where(energy > 0, energy, 1.0)
    return x, iteration


def _dots(a: Floats, b: Floats) -> Floats:
    """Return the scalar product (channels,) of each column of a and b (n, channels)."""
    return np.asarray(np.einsum("nc,nc->c", a, b))


def gmres(
    apply: Callable[[Any], Any],
    precondition: Callable[[Any], Any],
    residual: Any,
    target: Floats,
    most: int,
    progress: Progress,
) -> tuple[Any, int]:
    """Return an approximate solution x (n, channels) of ``A x = residual`` by GMRES, and the iterations.

    It stops when the residual of every channel is below its ``target`` (channels,), or after ``most`` iterations. One
    vector (n, channels) is stored for each iteration. A and the preconditioner may be indefinite, real or complex.

    Notes
    -----
    Saad and Schultz, SIAM J. Sci. Stat. Comput. 7 (1986), preconditioned from the right, so that the residual that it
    minimises is that of the equations.
    """
    start = _norms(residual)
    basis = [_over(residual, start)]
    hessenberg = np.zeros((len(start), most + 1, most), dtype=residual.dtype)
    finished, taken = start <= target, 0
    first = max(float(np.log(np.maximum(start / target, 2.0)).max()), 1e-300)
    while taken < most and not finished.all():
        column = hessenberg[:, : taken + 2, taken]
        image = apply(precondition(basis[-1]))
        for _ in range(2):  # orthogonalised twice, against rounding
            for row, vector in enumerate(basis):
                share = np.einsum("nc,nc->c", vector.conj(), image)
                image = image - vector * share
                column[:, row] += share
        column[:, -1] = _norms(image)
        basis.append(_over(image, column[:, -1].real))
        taken += 1
        norms = start * _least_residuals(hessenberg[:, : taken + 1, :taken])
        finished |= norms <= target
        progress("solve", float(np.clip(1 - np.log(np.maximum(norms / target, 1.0)).max() / first, 0, 1)))
    if not taken:
        return np.zeros_like(residual), 0
    weights = np.linalg.pinv(hessenberg[:, : taken + 1, :taken])[:, :, 0] * start[:, None]
    return precondition(sum(vector * weights[:, row] for row, vector in enumerate(basis[:-1]))), taken


def _least_residuals(hessenberg: Any) -> Floats:
    """Return min over y of ``|e - H y|`` (channels,) for each H (channels, k + 1, k), e the first unit vector."""
    rotation = np.linalg.qr(hessenberg, mode="complete").Q
    return np.asarray(np.abs(rotation[:, 0, -1]))


def _norms(vectors: Any) -> Floats:
    """Return the Euclidean norm (channels,) of each column of real or complex ``vectors`` (n, channels)."""
    return np.asarray(np.sqrt(np.einsum("nc,nc->c", vectors.conj(), vectors).real))


def _over(vectors: Any, norms: Floats) -> Any:
    """Return ``vectors`` (n, channels) divided by their ``norms`` (channels,); zero vectors stay zero."""
    return vectors * np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
