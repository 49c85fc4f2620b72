"""A round of transport: distances carried on along unit directions from where they are held."""

from __future__ import annotations

import cpmkit as ck
from cpmkit.applications.heat import ENOUGH
from cpmkit.facade import Solution
from cpmkit.preparing import Prepared
from cpmkit.protocols import Bools, Floats

#: Diffusion of the transport over the spacing: a cell number just below one.
DIFFUSION_SPACINGS = 1.05
#: Within so many spacings of an origin the straight distance is held, so strongly over the spacing.
HELD_SPACINGS, HELD_STRENGTH = 3.0, 10.0


def carriers(prepared: Prepared) -> Prepared:
    """Return the scene for rounds of transport: solved as exactly as they need, the first lends its preconditioner."""
    own = prepared.solver
    if own.solver_tolerance is None:
        prepared = prepared.solved_by(own.solver, solver_tolerance=ENOUGH, **own.further)
    return prepared.lending()


def carried(
    prepared: Prepared,
    field: ck.Field,
    held: Bools,
    target: Floats,
    sign: Floats | float = 1.0,
    guess: Solution | None = None,
) -> Solution:
    """Return phi of -e Lap phi + sign X . grad phi = sign - e div X, which is ``target`` (p,) where it is ``held``.

    Parameters
    ----------
    prepared : Prepared
        The manifold, of :func:`carriers`.
    field : Field
        X, unit vectors (p, d) along which phi grows.
    held : (p,) bool
        Where the target is held.
    target : (p,) float64
        The distance there.
    sign : (p,) float64
        Of phi: it is carried along X where it is positive, and the other way where it is negative.
    guess : Solution
        Near phi.
    """
    h = prepared.discretized.spacing
    hold = held * (HELD_STRENGTH / h)
    e = DIFFUSION_SPACINGS * h
    velocity = field.map(lambda _, one: (sign * one.T).T)
    f = ck.Divergence(field, -e, beside=prepared.field(sign + hold * target))
    problem = ck.Elliptic(f, diffusivity=e, velocity=velocity, c=prepared.field(hold))
    return prepared.solve(problem=problem, guess=guess)
