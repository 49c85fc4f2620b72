"""Whether the systems of a scene's equation are surely positive, as a multigrid needs them."""

from __future__ import annotations

import numpy as np

from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.laws import Interface, Spectral, takes_nothing
from cpmkit.scene.scene import Scene


def surely_definite(scene: Scene) -> bool:
    """Tell whether what is factorised or iterated on has no eigenvalue below zero, as far as numbers tell.

    Eigenvalues are sought by a shift. It lies below all of them unless a number is given, or conditions or c take from
    the energy. A c that is a function is asked nowhere: a multigrid refuses what turns out to be indefinite.
    """
    problem = scene.problem
    if not isinstance(problem, Eigen):
        c = problem.terms().c
        return callable(c) or bool(np.all(np.asarray(c) >= 0))
    laws = [one.law for one in scene.conditions]
    takes = not all(takes_nothing(law) or isinstance(law, (Interface, Spectral)) for law in laws)
    if takes or problem.near is not None:
        return False
    steklov = any(isinstance(law, Spectral) for law in laws)
    return not steklov or (not callable(problem.c) and bool(np.all(np.asarray(problem.c) >= 0)))
