"""Inner products and lengths of rows, written out by components: a row's result never depends on its batch."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats


def dots(a: Floats, b: Floats) -> Floats:
    """Return the inner products along the last axis."""
    total = a[..., 0] * b[..., 0]
    for k in range(1, a.shape[-1]):
        total = total + a[..., k] * b[..., k]
    return np.asarray(total)


def norms(a: Floats) -> Floats:
    """Return the lengths along the last axis."""
    return np.sqrt(dots(a, a))


def unit(a: Floats) -> Floats:
    """Return the rows (n, d) at length one, those of no length as zero."""
    length = norms(a)[:, None]
    if (length > 0).all():
        return np.asarray(a / length)
    with np.errstate(all="ignore"):
        return np.where(length > 0, a / length, 0.0)
