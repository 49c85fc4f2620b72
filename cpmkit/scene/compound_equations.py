"""Equations of eigenvalues, of coupled channels, and of fourth order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.runtime.arrays import number, positive, whole
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data
from cpmkit.scene.diffusivities import as_diffusivity
from cpmkit.scene.equations import EigenFamily, Equation, Terms, check_factor


@dataclass(frozen=True, eq=False)
class Coupled(Equation):
    """-div(a grad u_i) + c u_i + sum_j C_ij u_j = f_i: channels that are coupled at each point, in the Galerkin form.

    With C = s n n', n the normal and s large, u is a field of tangential vectors, as
    :func:`cpmkit.applications.vector_field` uses it.

    Parameters
    ----------
    coupling : callable
        C, a function of points (n, d) that returns matrices (n, k, k), k the number of channels.
    f : number, sequence or callable
        Right-hand side, of k channels, or one value for all of them.
    diffusivity, c : number or callable
        As for :class:`cpmkit.Elliptic`.
    lumped : bool
        Whether the mass matrix of c u is lumped, as for :class:`cpmkit.ScreenedPoisson`; that of C u is not.

    Raises
    ------
    InputError
        If C is not a function, a constant diffusivity not above zero, or c neither a number nor a function.

    Examples
    --------
    Two channels that relax towards each other.

    >>> import cpmkit as ck
    >>> import numpy as np
    >>> tied = ck.Coupled(lambda x: np.tile([[1.0, -1.0], [-1.0, 1.0]], (len(x), 1, 1)), f=[1.0, 0.0], c=1.0)
    >>> ck.solve(ck.Scene(ck.source("analytic.circle"), tied), spacing=0.2).evaluate([[1, 0]]).round(4)
    array([[0.6667, 0.3333]])
    """

    coupling: Callable[..., Any]
    f: Data = 0.0
    diffusivity: Data = 1.0
    c: Data = 0.0
    lumped: bool = False
    kind: ClassVar[str] = "coupled"
    family: ClassVar[str] = "coupled"
    #: The channels make one system.
    factorise_up_to: ClassVar[float] = 4.0

    def __post_init__(self) -> None:
        """Check the coupling, the diffusivity and c."""
        super().__post_init__()
        if not callable(self.coupling):
            raise InputError(
                f"coupling must be a function of points that returns matrices, got {shown(self.coupling)}."
            )
        diffusivity = as_diffusivity(self.diffusivity, "diffusivity of a coupled problem")
        object.__setattr__(self, "diffusivity", diffusivity)
        check_factor(self.c, "c of a coupled problem")

    def terms(self) -> Terms:
        """Return the terms that all channels have, without the coupling."""
        return Terms(self.f, self.c, self.diffusivity, lumped=self.lumped)


@dataclass(frozen=True, eq=False)
class Eigen(Equation[EigenFamily]):
    """-div(a grad u) + c u = lambda u, with homogeneous conditions: the eigenvalues nearest to ``near``.

    Where a side or an edge has the condition :class:`cpmkit.Steklov`, the equation is ``-div(a grad u) + c u = 0`` and
    lambda is in that condition instead. The solution is a :class:`cpmkit.EigenSolution`.

    Parameters
    ----------
    count : int
        Number of eigenvalues.
    near : float, optional
        Number to which the eigenvalues are nearest; by default the smallest are computed.
    diffusivity, c : number or callable
        As for :class:`cpmkit.Elliptic`.

    Raises
    ------
    InputError
        If the count is not a whole number above zero, ``near`` not a number, or a constant diffusivity not above zero.

    Examples
    --------
    The eigenvalues of the circle are 0, 1, 1, 4, 4, ...

    >>> import cpmkit as ck
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Eigen(count=5))
    >>> ck.solve(scene, spacing=0.05).eigenvalues.round(2) + 0.0
    array([0., 1., 1., 4., 4.])
    """

    count: int = 6
    near: float | None = None
    diffusivity: Data = 1.0
    c: Data = 0.0
    kind: ClassVar[str] = "eigen"
    family: ClassVar[str] = "eigen"
    #: About sixty solves use one factorisation (sphere, 8,000 unknowns: 10 seconds; with an iterative solver 80).
    factorise_up_to: ClassVar[float] = 80.0
    factorise_beside_multigrid: ClassVar[float | None] = 8.0
    accepted: ClassVar[str] = "use Dirichlet(0), Neumann(0), Robin(alpha, beta, 0) or Steklov()"

    def __post_init__(self) -> None:
        """Check the number of eigenvalues, ``near``, the diffusivity and c."""
        super().__post_init__()
        whole(self.count, "count of an eigenvalue problem", 1)
        if self.near is not None:
            number(self.near, "near of an eigenvalue problem")
        diffusivity = as_diffusivity(self.diffusivity, "diffusivity of an eigenvalue problem")
        object.__setattr__(self, "diffusivity", diffusivity)
        check_factor(self.c, "c of an eigenvalue problem")

    def factors_up_to(self, multigrid: bool) -> float:
        """Return the largest number of unknowns for the direct solver, in units of that for a single definite system.

        With multigrid and eigenvalues near a number it is 60: inside the spectrum each multigrid solve takes about 20
        cycles.
        """
        return 60.0 if multigrid and self.near is not None else super().factors_up_to(multigrid)

    def terms(self) -> Terms:
        """Return the terms of the operator -div(a grad u) + c u, with f = 0."""
        return Terms(0.0, self.c, self.diffusivity)

    def __str__(self) -> str:
        return str(self.terms()).removesuffix("f") + "lambda u"

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Raise if a condition is not accepted, as for any equation, or if its data are not all zero.

        Raises
        ------
        SceneError
            For the first condition that is not accepted.
        """
        super().check_conditions(conditions)
        for label, condition in conditions:
            if any(callable(datum) or np.any(np.asarray(datum, dtype=object) != 0) for _, datum in condition.data()):
                raise SceneError(f"{label} has data where an eigenvalue problem takes zero alone; {self.accepted}.")


@dataclass(frozen=True, eq=False)
class Biharmonic(Equation):
    """c u + Lap^2 u = f: the bending of a thin plate, on an elastic bed where c is above zero.

    :class:`cpmkit.SimplySupported` prescribes u and Lap u; ``Dirichlet(g)`` is the same with Lap u = 0. ``Neumann(g)``
    prescribes du/db = g and d(Lap u)/db = 0: a plate guided at its edge. A clamped edge, with u and du/db, is not
    available, as it has no condition for Lap u. The solution is a
    :class:`cpmkit.facade.BiharmonicSolution`, which has Lap u too.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`cpmkit.Poisson`.
    c : float
        Not below zero. Where it is zero and a piece of the manifold has no support, the mean of f must be zero there,
        and the solution has mean zero, as for :class:`cpmkit.Poisson`.

    Raises
    ------
    InputError
        If c is below zero or not a finite number.

    Examples
    --------
    >>> import cpmkit as ck
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Biharmonic(lambda points: 2 * points[:, 0]))
    >>> ck.solve(scene, spacing=0.05).evaluate([[1, 0]]).round(3)
    array([1.])
    """

    f: Data
    c: float = 1.0
    kind: ClassVar[str] = "biharmonic"
    family: ClassVar[str] = "biharmonic"
    #: Its system is complex, and takes four times as long to factorise; iterations are as for a screened problem.
    factorise_up_to: ClassVar[float] = 0.2
    accepted: ClassVar[str] = (
        "a biharmonic problem takes SimplySupported, Dirichlet (with Lap u = 0) and Neumann, and no clamped edge"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if number(self.c, "c of a biharmonic problem") != 0:
            positive(self.c, "c of a biharmonic problem, where it is not zero,")

    def terms(self) -> Terms:
        """Return the terms c u = f, without Lap^2 u."""
        return Terms(self.f, float(self.c))

    def __str__(self) -> str:
        return f"{f'{self.c:g} u + ' if self.c else ''}Lap^2 u = f"
