"""Whether the systems of a scene's equation are surely positive, or else waves, as a multigrid needs them."""

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


def surely_iterated(scene: Scene) -> bool:
    """Tell whether a multigrid serves: systems are surely positive, or what is below zero are waves.

    That is so of equations with c below zero, and of eigenvalues sought near a number, unless conditions take from the
    energy or have the lambda that is sought.
    """
    problem = scene.problem
    if not isinstance(problem, Eigen) or surely_definite(scene):
        return True
    laws = [one.law for one in scene.conditions]
    return problem.near is not None and all(takes_nothing(law) or isinstance(law, Interface) for law in laws)
