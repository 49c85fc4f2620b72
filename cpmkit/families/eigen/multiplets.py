"""Whether the eigenvalues that are asked for end inside a multiplet."""

from __future__ import annotations

import numpy as np

from cpmkit.scene.compound_equations import Eigen
from cpmkit.types import Floats

#: Eigenvalues that differ by less than this share of their distance from the shift may be one of the manifold.
ONE_EIGENVALUE_SHARE = 1e-3
#: What is told of it.
CUT = "ends inside a multiplet"


def cut_multiplet(problem: Eigen, values: Floats, shift: float) -> list[str]:
    """Return a sentence where one of the ``values`` (k,) that is left out is all but equal to one that is told.

    Parameters
    ----------
    problem : Eigen
        How many are asked for, and near which number.
    values : (k,) float64
        More than are asked for, in any order.
    shift : float
        From which distances are measured.
    """
    about = shift if problem.near is None else problem.near
    ordered = values[np.argsort(np.abs(values - about), kind="stable")]
    told, left = ordered[: problem.count], ordered[problem.count :]
    gaps = np.abs(left[:, None] - told).min(axis=1, initial=np.inf)
    cut = left[gaps <= ONE_EIGENVALUE_SHARE * np.abs(left - shift)]
    if not len(cut):
        return []
    known = len(cut) < len(left)
    return [
        f"count={problem.count} {CUT}: {'' if known else 'at least '}{len(cut)} further eigenvalue"
        f"{'s' if len(cut) > 1 else ''} near {cut[0]:.6g} {'are' if len(cut) > 1 else 'is'} left out, and which of its "
        f"functions are told is chance; use count={problem.count + len(cut)}{'' if known else ' or more'}."
    ]
