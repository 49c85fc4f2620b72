"""Eigenpairs without factors: a block of functions, improved by what a preconditioner makes of their residuals.

It is Knyazev's LOBPCG for ``B u = theta (A - sigma B) u``, sigma below all eigenvalues, and the largest theta; lambda
is ``sigma + 1 / theta``. So the inner product is that of A - sigma B, which is positive definite whatever B is:
the mass of splines is singular, and where Steklov's conditions stand B lives on boundaries alone. What B does not see
has theta = 0, the far end of what is sought.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.families.eigen.inverse_iteration import InverseIteration, Pairs
from cpmkit.runtime import memory
from cpmkit.types import Floats, Ints

#: At most so many rounds; 15 to 25 are usual.
MOST_ROUNDS = 100
#: The block is iterated until residuals are below this share of the tolerance: they are computed anew at the end.
ROUNDS_SHARE = 0.5
#: Directions whose share of a block's energy is below this are rounding.
DEPENDENT_SHARE = 1e-12
#: The iteration is worth while where the block is at most this share of the unknowns.
MOST_BLOCK_SHARE = 0.1

#: At its peak the iteration holds so many blocks of functions: three, with their energies and images, and what becomes
#: of two of them, and the corrections.
HELD_BLOCKS = 17


@dataclass(frozen=True, eq=False)
class Block:
    """Functions S (n, k) with ``(A - sigma B) S`` and ``B S``."""

    functions: Floats
    energies: Floats
    images: Floats


def block_pairs(stepped: InverseIteration, count: int, width: int) -> Pairs:
    """Return the ``width`` eigenpairs next above the shift, ascending.

    Those after the first ``count`` are less exact.

    Raises
    ------
    ResolutionError
        If the memory of this process cannot hold the functions.
    ConvergenceError
        If a residual of the first ``count`` is above the tolerance after all rounds, or A - sigma B turns out not to be
        positive definite.
    """
    _check_fits(stepped, count, width)
    target = ROUNDS_SHARE * stepped.context.tolerance
    start = np.random.default_rng(0).normal(size=(stepped.operator.size, width))
    first = stepped.preconditioned(stepped.image(start))
    block = _made(stepped, _orthonormal(stepped, first))
    theta, block, past = _best([block], block.functions.shape[1], np.zeros(0, dtype=np.int64))
    active = np.arange(len(theta))
    for _ in range(MOST_ROUNDS):
        correction = stepped.preconditioned(block.images[:, active] - block.energies[:, active] * theta[active])
        changes = _changes(stepped, correction, theta[active], block.functions[:, active])
        open_ = changes > target
        active, correction = active[open_], correction[:, open_]
        if not np.any(active < count):
            return Pairs(stepped.shift + 1 / theta, block.functions)
        further = _made(stepped, _orthonormal(stepped, correction, [block, past]))
        theta, block, past = _best([block, past, further], len(theta), active)
    raise _not_converged(stepped, float(changes[open_].max()))


def _check_fits(stepped: InverseIteration, count: int, width: int) -> None:
    unknowns, limit = stepped.operator.size, memory.memory_limit()
    needed = 8.0 * HELD_BLOCKS * width * unknowns
    if needed > limit.bytes:
        raise ResolutionError(
            f"count={count} of {unknowns} unknowns needs about {needed / 2**30:.3g} GiB for functions, and {limit}; "
            "ask for fewer, or use a larger spacing."
        )


def block_changes(stepped: InverseIteration, values: Floats, functions: Floats) -> Floats:
    """Return by how much of its size about each function (n, k) changes in one more step, residuals computed anew."""
    theta, block = 1 / (values - stepped.shift), _made(stepped, functions)
    return _changes(stepped, stepped.preconditioned(block.images - block.energies * theta), theta, functions)


def _changes(stepped: InverseIteration, corrections: Floats, theta: Floats, functions: Floats) -> Floats:
    form = stepped.context.discretized
    squares = [np.diag(form.inner(one, one)) for one in (corrections, functions)]
    return np.asarray(np.sqrt(squares[0] / squares[1]) / np.abs(theta))


def _made(stepped: InverseIteration, functions: Floats) -> Block:
    stepped.products += functions.shape[1]
    return Block(functions, stepped.operator.apply(functions), stepped.image(functions))


def _orthonormal(stepped: InverseIteration, functions: Floats, kept: Sequence[Block] = ()) -> Floats:
    """Return functions of energy one, orthogonal to each other and to those ``kept``; twice, against rounding.

    Raises
    ------
    ConvergenceError
        If an energy is not above zero.
    """
    functions = functions / np.sqrt(_energies(stepped, functions))
    for _ in range(2):
        for one in kept:
            functions = functions - one.functions @ (one.energies.T @ functions)
        stepped.products += functions.shape[1]
        gram = functions.T @ stepped.operator.apply(functions)
        new = np.diag(gram) > DEPENDENT_SHARE  # others were sums of those kept
        functions = functions[:, new] @ _root_inverse(gram[np.ix_(new, new)])
    return functions


def _energies(stepped: InverseIteration, functions: Floats) -> Floats:
    """Return the energy of each function (n, k).

    Raises
    ------
    ConvergenceError
        If one is not above zero.
    """
    stepped.products += functions.shape[1]
    energies = np.einsum("nk,nk->k", functions, stepped.operator.apply(functions))
    if not np.all(energies > 0):
        raise _indefinite(stepped)
    return np.asarray(energies)


def _root_inverse(gram: Floats) -> Floats:
    """Return R (k, m) with ``R' gram R = 1``, m less than k where functions depend on each other."""
    scale = 1 / np.sqrt(np.diag(gram))
    values, vectors = np.linalg.eigh(gram * scale * scale[:, None])
    kept = values > DEPENDENT_SHARE * values.max(initial=0.0)
    return np.asarray(scale[:, None] * vectors[:, kept] / np.sqrt(values[kept]))


def _best(directions: Sequence[Block], width: int, active: Ints) -> tuple[Floats, Block, Block]:
    """Return theta, the best functions among all directions, and what they took from others than their predecessors.

    The latter is for the ``active`` functions, and orthogonal to the best (Hetmaniuk and Lehoucq, J. Comput. Phys. 218,
    2006): the next round's three blocks are then orthonormal, and its matrices never near to singular.
    """
    from scipy.linalg import eigh

    gram = np.block([[one.functions.T @ other.energies for other in directions] for one in directions])
    images = np.block([[one.functions.T @ other.images for other in directions] for one in directions])
    theta, weights = eigh(0.5 * (images + images.T), 0.5 * (gram + gram.T))
    theta, best = theta[::-1][:width], weights[:, ::-1][:, :width]
    moved = best[:, active].copy()
    moved[:width] = 0.0
    for _ in range(2 if len(active) else 0):
        moved -= best @ (best.T @ (gram @ moved))
        moved = moved @ _root_inverse(moved.T @ gram @ moved)
    return theta, _combined(directions, best), _combined(directions, moved)


def _combined(directions: Sequence[Block], weights: Floats) -> Block:
    """Return the sums of all functions with ``weights`` (k, m)."""
    parts = np.split(weights, np.cumsum([one.functions.shape[1] for one in directions])[:-1])
    pairs = list(zip(directions, parts, strict=True))
    made = {name: sum(getattr(one, name) @ part for one, part in pairs) for name in ("functions", "energies", "images")}
    return Block(**made)


def _indefinite(stepped: InverseIteration) -> ConvergenceError:
    reason = f"there are eigenvalues below {stepped.shift:.6g}, above which the solver 'multigrid' seeks them"
    report = stepped.context.report(False, stepped.solves, stepped.products, np.inf, reason)
    return ConvergenceError(f"The eigenvalues did not converge: {reason}; use solver='direct'.", report)


def _not_converged(stepped: InverseIteration, change: float) -> ConvergenceError:
    tolerance = stepped.context.tolerance
    reason = f"functions still change by {change:.2e} of their size after {MOST_ROUNDS} rounds, {tolerance:.2e} asked"
    report = stepped.context.report(False, stepped.solves, stepped.products, change, reason)
    remedy = "ask for a larger solver_tolerance, or use solver='direct'"
    return ConvergenceError(f"The eigenvalues did not converge: {reason}; {remedy}.", report)
