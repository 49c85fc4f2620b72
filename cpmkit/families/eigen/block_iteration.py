"""Eigenpairs without factorisation: a block of functions, improved by preconditioned residuals (LOBPCG).

Knyazev's LOBPCG is applied to ``B u = theta (A - sigma B) u``, sigma below all eigenvalues, for the largest theta;
lambda is ``sigma + 1 / theta``. The inner product is that of A - sigma B, called the energy, which is positive definite
for any B: the mass matrix of splines is singular, and that of Steklov conditions is zero away from boundaries.
Functions in the kernel of B have theta = 0, the other end of the spectrum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.families.eigen.inverse_iteration import EigenPairs, InverseIteration
from cpmkit.runtime import memory
from cpmkit.types import Floats, Ints

MOST_ROUNDS = 100  #: The largest number of rounds; 15 to 25 are usual.
#: Largest energy of a linearly dependent direction, as a share of the energy of its block: rounding.
DEPENDENT_SHARE = 1e-12
#: Number of blocks of functions in memory at the peak: three with products, copies of two of these, and corrections.
PEAK_BLOCKS = 17


@dataclass(frozen=True, eq=False)
class FunctionBlock:
    """Functions, with their products with the two matrices of the problem."""

    functions: Floats  #: S (n, k).
    shifted_products: Floats  #: (A - sigma B) S (n, k).
    mass_products: Floats  #: B S (n, k).


def block_pairs(iteration: InverseIteration, count: int, width: int) -> EigenPairs:
    """Return the ``width`` least eigenvalues, ascending, with eigenvectors; convergence is checked for ``count`` only.

    ``iteration`` must have a preconditioner. Raises ResolutionError if the functions exceed the memory of this process.
    Raises ConvergenceError if a pair of the first ``count`` changes by more than half the tolerance after
    :data:`MOST_ROUNDS`, or A - sigma B is not positive definite.
    """
    _check_fits(iteration, count, width)
    target = 0.5 * iteration.context.tolerance  # residuals are recomputed at the end
    start = np.random.default_rng(0).normal(size=(iteration.operator.size, width))
    first = iteration.apply_preconditioner(iteration.apply_mass(start))
    block = _make_block(iteration, _orthonormalise(iteration, first))
    theta, block, past = _rayleigh_ritz([block], block.functions.shape[1], np.zeros(0, dtype=np.int64))
    active = np.arange(len(theta))
    for _ in range(MOST_ROUNDS):
        correction = iteration.apply_preconditioner(
            block.mass_products[:, active] - block.shifted_products[:, active] * theta[active]
        )
        changes = _relative_changes(iteration, correction, theta[active], block.functions[:, active])
        unconverged = changes > target
        active, correction = active[unconverged], correction[:, unconverged]
        if not np.any(active < count):
            return EigenPairs(iteration.shift + 1 / theta, block.functions)
        further = _make_block(iteration, _orthonormalise(iteration, correction, [block, past]))
        theta, block, past = _rayleigh_ritz([block, past, further], len(theta), active)
    change, tolerance = float(changes[unconverged].max()), iteration.context.tolerance
    reason = f"functions change by {change:.2e} of their size after {MOST_ROUNDS} rounds, tolerance {tolerance:.2e}"
    raise iteration.failure(reason, "use solver='direct', or give a larger solver_tolerance", change)


def _check_fits(iteration: InverseIteration, count: int, width: int) -> None:
    """Raise ResolutionError if LOBPCG with ``width`` functions exceeds the memory; ``count`` is for the message."""
    unknowns, limit = iteration.operator.size, memory.memory_limit()
    needed = 8.0 * PEAK_BLOCKS * width * unknowns
    if needed > limit.bytes:
        raise ResolutionError(
            f"count={count} of {unknowns} unknowns needs about {needed / 2**30:.3g} GiB for functions, and {limit}; "
            "ask for fewer, or use a larger spacing."
        )


def block_changes(iteration: InverseIteration, values: Floats, functions: Floats) -> Floats:
    """Return the relative change (k,) of each of ``functions`` (n, k) in one more preconditioned step.

    ``values`` (k,) are their eigenvalues.
    """
    theta, block = 1 / (values - iteration.shift), _make_block(iteration, functions)
    correction = iteration.apply_preconditioner(block.mass_products - block.shifted_products * theta)
    return _relative_changes(iteration, correction, theta, functions)


def _relative_changes(iteration: InverseIteration, corrections: Floats, theta: Floats, functions: Floats) -> Floats:
    """Return the root mean squares (k,) of ``corrections`` (n, k) over those of abs(theta) times ``functions``."""
    form = iteration.context.discretized
    squares = [np.diag(form.inner(block, block)) for block in (corrections, functions)]
    return np.asarray(np.sqrt(squares[0] / squares[1]) / np.abs(theta))


def _make_block(iteration: InverseIteration, functions: Floats) -> FunctionBlock:
    """Return ``functions`` S (n, k) with (A - sigma B) S and B S; add k to ``iteration.products``, the work counter."""
    iteration.products += functions.shape[1]
    return FunctionBlock(functions, iteration.operator.apply(functions), iteration.apply_mass(functions))


def _orthonormalise(iteration: InverseIteration, functions: Floats, blocks: Sequence[FunctionBlock] = ()) -> Floats:
    """Return m linear combinations (n, m) of ``functions`` (n, k), orthonormal and orthogonal to ``blocks``.

    The inner product is that of A - sigma B. m is less than k if the functions and blocks are linearly dependent.
    Orthogonalisation is done twice, because of rounding. The products with A - sigma B are added to the counter
    ``iteration.products``. Raises ConvergenceError if the square norm of a function is not positive.
    """
    iteration.products += functions.shape[1]
    energies = np.einsum("nk,nk->k", functions, iteration.operator.apply(functions))
    if not np.all(energies > 0):
        reason = f"there are eigenvalues below {iteration.shift:.6g}, above which the solver 'multigrid' seeks them"
        raise iteration.failure(reason, "use solver='direct'")
    functions = functions / np.sqrt(energies)
    for _ in range(2):
        for block in blocks:
            functions = functions - block.functions @ (block.shifted_products.T @ functions)
        iteration.products += functions.shape[1]
        gram = functions.T @ iteration.operator.apply(functions)
        independent = np.diag(gram) > DEPENDENT_SHARE
        functions = functions[:, independent] @ _root_inverse(gram[np.ix_(independent, independent)])
    return functions


def _root_inverse(gram: Floats) -> Floats:
    """Return R (k, m) with ``R' gram R = 1``: for functions S (n, k) with inner products ``gram``, S R is orthonormal.

    m is less than k if the functions are linearly dependent.
    """
    scale = 1 / np.sqrt(np.diag(gram))
    values, vectors = np.linalg.eigh(gram * scale * scale[:, None])
    independent = values > DEPENDENT_SHARE * values.max(initial=0.0)
    return np.asarray(scale[:, None] * vectors[:, independent] / np.sqrt(values[independent]))


def _rayleigh_ritz(
    blocks: Sequence[FunctionBlock], width: int, active: Ints
) -> tuple[Floats, FunctionBlock, FunctionBlock]:
    """Return the ``width`` largest Ritz values theta (width,) in the span of ``blocks``, and two blocks of functions.

    The first block has the Ritz functions. The second has the components of the Ritz functions ``active`` (a,) outside
    ``blocks[0]``, made orthogonal to the first block (Hetmaniuk and Lehoucq, J. Comput. Phys. 218, 2006): then the
    blocks of the next round are orthonormal, and its matrices are never nearly singular.
    """
    from scipy.linalg import eigh

    gram = np.block([[block.functions.T @ other.shifted_products for other in blocks] for block in blocks])
    images = np.block([[block.functions.T @ other.mass_products for other in blocks] for block in blocks])
    theta, weights = eigh(0.5 * (images + images.T), 0.5 * (gram + gram.T))
    theta, best = theta[::-1][:width], weights[:, ::-1][:, :width]
    outside = best[:, active].copy()
    outside[:width] = 0.0
    for _ in range(2 if len(active) else 0):
        outside -= best @ (best.T @ (gram @ outside))
        outside = outside @ _root_inverse(outside.T @ gram @ outside)
    return theta, _combine_blocks(blocks, best), _combine_blocks(blocks, outside)


def _combine_blocks(blocks: Sequence[FunctionBlock], weights: Floats) -> FunctionBlock:
    """Return m linear combinations, with ``weights`` (k, m), of the k functions of all blocks together."""
    parts = np.split(weights, np.cumsum([block.functions.shape[1] for block in blocks])[:-1])
    pairs = list(zip(blocks, parts, strict=True))
    sums = {name: sum(getattr(block, name) @ part for block, part in pairs) for name in vars(blocks[0])}
    return FunctionBlock(**sums)
