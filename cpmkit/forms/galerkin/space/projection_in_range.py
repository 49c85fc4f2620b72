"""L2 projections of data without overshoots: data that the spacing does not resolve are averaged."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.types import Bools, Floats

#: Data have jumps or spikes if their projection differs from them by more than the first share of their range anywhere:
#: at kinks a spacing or two apart it differs by up to .24, and means would be four times as far off (measured).
#: They are averaged on splines that overlap with one where the difference exceeds the second share, and on further
#: overlapping splines as long as coefficients are outside of the range by more than the third share.
UNRESOLVED_SHARE, AVERAGED_SHARE, OVERSHOOT_SHARE = 0.25, 0.1, 0.02


def project_in_range(space: FunctionSpace, values: Floats) -> Floats:
    """Return the unknowns (n, k) of L2 projections of ``values`` (p, k) at the samples, without overshoots.

    Projections overshoot by a tenth of a jump on both sides, and below zero beside a spike. Near jumps and spikes the
    coefficients are the means of the data weighted with each spline, which are in the range and spread the data as heat
    conduction does in a time of (degree + 1) h^2 / 12. On each connected piece the difference from the total of the
    data is added to the means, in proportion to their distances from both ends of the range.
    """
    loads = space.load(values)
    u = space.solve_projection(loads)
    off = np.abs(space.values_at_samples(u) - values)
    low, high = values.min(axis=0, initial=np.inf), values.max(axis=0, initial=-np.inf)
    for k in np.flatnonzero(off.max(axis=0, initial=0.0) > UNRESOLVED_SHARE * (high - low)):
        is_off = off[:, k] > AVERAGED_SHARE * (high[k] - low[k])
        u[:, k] = _averaged_near(space, loads[:, k], u[:, k], is_off, (low[k], high[k]))
    return u


def _averaged_near(space: FunctionSpace, load: Floats, u: Floats, is_off: Bools, ends: tuple[float, float]) -> Floats:
    """Return the coefficients ``u`` (n,) of a projection, with means of the data near samples where it ``is_off`` (p,).

    ``load`` (n,) are the integrals of the data times each spline, ``ends`` the least and largest value of the data.
    """
    (low, high), count, integrals = ends, space.spline_count, np.zeros(len(u))
    integrals[:count] = space.spline_integrals
    seen, least = integrals > 0, OVERSHOOT_SHARE * (high - low)
    divisors = np.where(seen, integrals, 1.0)
    means = np.where(seen, load / divisors, u)
    means[count:] = 0.0
    near, is_outside = space.load(is_off[:, None].astype(np.float64))[:, 0] > 0, np.ones(len(u), dtype=bool)
    if count < len(u):  # functions that are no splines have no means
        near[:] = True
    while (grown := near | (seen & is_outside & (space.mass.matrix @ near.astype(np.float64) > 0))).sum() > near.sum():
        near, is_outside = grown, (u < low - least) | (u > high + least)
    clipped = np.clip(u, low, high)
    result = np.where(near, means, np.where(np.abs(clipped - u) <= least, clipped, u))
    room = np.where(near, np.maximum((means - low) * (high - means), 0.0), 0.0)
    missing, room_of_piece = (space.pieces.sums(integrals * each) for each in (means - result, room))
    share = missing / np.where(room_of_piece > 0, room_of_piece, 1.0)
    result = result + space.pieces.spread_to_rows(share) * room
    is_kept = np.abs(space.pieces.sums(integrals * (means - result))) <= 1e-12 * (high - low) * integrals.sum()
    rounding = 1e-12 * max(abs(low), abs(high))
    is_within = ~near | ((result >= low - rounding) & (result <= high + rounding))
    return result if is_kept.all() and is_within.all() else means
