"""Krylov iterations on several channels in lockstep, and the loop that restarts them from the true residual."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np

from cpmkit.linear.direct import IndefiniteError
from cpmkit.types import Floats, Progress

#: Returns a correction (n, k), the iterations and the products with A that it took, from a residual (n, k), the norms
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
    """Return u (n, channels) with ``A u = b``, the iterations, and the products with A of all channels.

    Each round computes the true residual and corrects the channels in which it is above the tolerance.

    Parameters
    ----------
    residual_of : callable
        Returns ``b - A u``.
    b : (n, channels)
    guess : (n, channels) or None
        The first u, zero if None.
    tolerance : float
        Relative residual of each channel.
    correct : Correction
        The Krylov iteration.
    max_iterations : int
        Of all rounds together.
    target_share : float
        The residual of the recursion is to fall to this share of the tolerance, because it drifts from the true one.
    rounds : int, optional
        Most rounds.
    round_iterations : int, optional
        Most iterations of a round.
    first_slack : float
        In the first round the residual has to be so many times smaller than the tolerance to be accepted.
    stops_when_stalled : bool
        Whether to stop after a round that ended early and halved the residual of no channel.
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
    """Return an approximation x (n, channels) of ``A x = residual`` by conjugate gradients, and the iterations.

    A channel is finished where ``|r|`` is below its ``target`` (channels,), and where ``(r, M r)^(1/2)``, in which
    large entries of A do not hide the error, has fallen by ``slack`` times that factor; or after ``most`` iterations.

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
    return np.asarray(np.einsum("nc,nc->c", a, b))


def gmres(
    apply: Callable[[Any], Any],
    precondition: Callable[[Any], Any],
    residual: Any,
    target: Floats,
    most: int,
    progress: Progress,
) -> tuple[Any, int]:
    """Return an approximation x (n, channels) of ``A x = residual`` by GMRES, and the iterations; real or complex.

    It stops where the residual of every channel is below its ``target`` (channels,), or after ``most`` iterations. One
    vector (n, channels) is stored for each iteration. A and the preconditioner may be indefinite.

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
    """Return the minimum over y of ``|e - H y|``, e the first unit vector, for each of the H (channels, k + 1, k)."""
    rotation = np.linalg.qr(hessenberg, mode="complete").Q
    return np.asarray(np.abs(rotation[:, 0, -1]))


def _norms(vectors: Any) -> Floats:
    return np.asarray(np.sqrt(np.einsum("nc,nc->c", vectors.conj(), vectors).real))


def _over(vectors: Any, norms: Floats) -> Any:
    """Return the vectors divided by their norms; zero vectors, of channels that are solved, stay zero."""
    return vectors * np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
