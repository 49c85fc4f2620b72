"""A scene of the extremes suite as plain values: it prints as Python, builds itself, and knows its exact solution.

Everything is stated in local coordinates, in which the shape is about 1 large: -div(a grad u) + v . grad u + c u = f
there is, after a similarity of scale s, the same equation with f / s^2, c / s^2, v / s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from extremes.ambient import BoxModes, Linear, Place, Sum, Waves
from extremes.shapes import Arc, Box, Cap, Cylinder, Helix, PlaneCurve, Plate, Shape, Spheroid, Torus

import cpmkit as ck

__all__ = [
    "Arc", "Box", "BoxModes", "Cap", "Case", "Curve", "Cylinder", "Helix", "Linear", "Pin", "Place", "PlaneCurve",
    "Plate", "Spheroid", "Sum", "Torus", "Waves",
]  # fmt: skip

Field = Callable[[Any], Any]
#: Steps of problems in time, which end after ten of them.
STEP, STEPS = 0.02, 10
#: Of conditions of Robin, du/db + BETA u, in local coordinates.
BETA = 2.0


@dataclass(frozen=True)
class Curve:
    """A circle about the axis, or its part between two angles, with a condition; on plates a straight line.

    Parameters
    ----------
    at : float
        Which one, in [-1, 1].
    condition : str
        On both sides, ``"dirichlet"``, ``"neumann"``, ``"robin"``, ``"transmission"``, or two of them with a comma,
        of the left and of the right side.
    span : tuple of float, optional
        Angles, or on plates coordinates along the line, between which it lies.
    """

    at: float
    condition: str
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class Pin:
    """A point of the shape, of a seed of its own, with a condition, as of :class:`Curve`."""

    seed: int
    condition: str


@dataclass(frozen=True)
class Case:
    """A scene, how it is solved, and the law that its solution is held to.

    Parameters
    ----------
    shape : Shape
    kind : str
        The representation, see :meth:`Shape.source`.
    place : Place
        Where it is in the scene.
    equation : str
        ``"screened"``, ``"poisson"``, ``"elliptic"``, ``"helmholtz"``, ``"heat"``, ``"reaction"``, ``"laplace"``,
        ``"biharmonic"`` or ``"eigen"``.
    law : str
        See :mod:`extremes.laws`.
    u : Waves
        The exact solution, or, of laws that need none, the load.
    spacing : float
        In local coordinates.
    terms : dict
        ``c``, ``wavenumber``: numbers; ``diffusivity``: Waves; ``velocity``: a vector; ``tensor``: rows.
    inside : tuple
        Curves and pins.
    edge : str
        The condition at rims.
    step : float
        By how much u is larger on the left of the first curve.
    twin : tuple of float, optional
        By what a second copy of the shape is moved, which the union has beside the first one.
    origin : tuple of float, optional
        A node of the lattice, in units of the spacing.
    options : dict
        Of :func:`cpmkit.solve`; ``tolerance`` stands in place of the spacing.
    other : dict
        What is replaced in the second scene of laws that compare two.
    """

    shape: Shape
    kind: str
    place: Place
    equation: str
    law: str
    u: Waves
    spacing: float
    terms: dict[str, Any] = field(default_factory=dict)
    inside: tuple[Curve | Pin, ...] = ()
    edge: str = "dirichlet"
    step: float = 0.0
    twin: tuple[float, ...] | None = None
    origin: tuple[float, ...] | None = None
    options: dict[str, Any] = field(default_factory=dict)
    other: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return Python that judges the case; run it with ``PYTHONPATH=tests``."""
        lines = ["from extremes.cases import *", "from extremes.laws import judge", f"print(judge({self!r}))"]
        return "\n".join(lines)

    # what is exact, in local coordinates ------------------------------------------------------------------------

    def left(self, x: Any) -> Any:
        """Return which local points are on the left of the first curve: above it, as circles run about the axis."""
        at = self.inside[0].at
        return x[:, 1] > at if isinstance(self.shape, Plate) else x[:, 2] > self.shape.parallel(at)[0]

    def exact(self, x: Any, t: float | None = None) -> Any:
        """Return u (n,) at local points."""
        u = self.u.value(x)
        return (u + self.step * self.left(x) if self.step else u) * self.growth(t)

    def growth(self, t: float | None) -> Any:
        """Return by what u is multiplied in the course of time."""
        return 1.0 if t is None else 1 + 0.5 * np.sin(3 * t)

    def flow(self, x: Any) -> Any:
        """Return -div(a grad u) + v . grad u (n,) on the shape."""
        P, g, H = self.shape.projector(x), self.u.gradient(x), self.u.hessian(x)
        if "tensor" in self.terms:
            return -self._tensor_flow(x, np.array(self.terms["tensor"]), P, g, H)
        lap = np.einsum("nij,nij->n", P, H) + np.sum(self.shape.mean_vector(x) * g, axis=1)
        found = -lap
        if "diffusivity" in self.terms:
            a = self.terms["diffusivity"]
            found = a.value(x) * found - np.einsum("ni,nij,nj->n", a.gradient(x), P, g)
        if "velocity" in self.terms:
            found = found + np.einsum("i,nij,nj->n", np.array(self.terms["velocity"]), P, g)
        return found

    def _tensor_flow(self, x: Any, A: Any, P: Any, g: Any, H: Any) -> Any:
        """Return div_S(P A P g): of G = A P g, tr(P DG) - (n . G) div n."""
        n, S = self.shape.normal(x), self.shape.bending(x)
        along = np.einsum("ni,ni->n", n, g)
        turned = np.einsum("nij,nj->ni", S, g) + np.einsum("nij,nj->ni", P @ H, n)
        D = H - S * along[:, None, None] - n[:, :, None] * turned[:, None, :]
        G = np.einsum("ij,njk,nk->ni", A, P, g)
        return np.einsum("nij,jk,nkl,nli->n", P, A, D, P) - np.sum(n * G, axis=1) * np.trace(S, axis1=1, axis2=2)

    # the scene --------------------------------------------------------------------------------------------------

    def places(self) -> list[Place]:
        """Return the places of the shape and of its twin."""
        if self.twin is None:
            return [self.place]
        return [self.place, replace(self.place, translation=tuple(self.place.world([self.twin])[0].tolist()))]

    def local(self, x: Any) -> Any:
        """Return points (n, d) in the local coordinates of the copy that they are nearer to."""
        y = self.place.local(x)
        if self.twin is None:
            return y
        way = np.array(self.twin)
        return y - np.where(y @ way > 0.5 * way @ way, 1.0, 0.0)[:, None] * way

    def data(self, function: Field, power: int = 0) -> Field:
        """Return a function of the scene's points: of local ones, over the scale to a power; one with t of both."""
        scale = self.place.scale**power
        if self.equation in ("heat", "reaction"):
            return lambda x, t: function(self.local(x)) * self.growth(t) / scale
        return lambda x: function(self.local(x)) / scale

    def scene(self) -> ck.Scene:
        """Return what is solved."""
        sources = [self.shape.source(self.kind, place) for place in self.places()]
        surface = sources[0] if len(sources) == 1 else ck.source("union", members=sources)
        inside = [self.boundary(number, one) for number, one in enumerate(self.inside)]
        if self.shape.closed:
            return ck.Scene(surface, self.problem(), inside)
        above = (lambda x: self.step * self.left(x)) if self.step else 0.0
        edge = self.condition(self.edge, lambda x: self.shape.rim_normal(x), above)
        return ck.Scene(surface, self.problem(), inside, edge)

    def load(self, x: Any) -> Any:
        """Return f (n,) at local points, of the steady part of the equation."""
        if self.law not in EXACT:
            return self.u.value(x)
        c = self.terms.get("c", 0.0) - self.terms.get("wavenumber", 0.0) ** 2
        return self.flow(x) + c * self.exact(x)

    def problem(self) -> Any:
        """Return the equation."""
        s, terms = self.place.scale, self.terms
        f, c = self.data(self.load, 2), terms.get("c", 0.0) / s**2
        if self.equation == "screened":
            return ck.ScreenedPoisson(f, c=c)
        if self.equation == "poisson":
            return ck.Poisson(f)
        if self.equation == "laplace":
            return ck.Laplace()
        if self.equation == "helmholtz":
            return ck.Helmholtz(f, wavenumber=terms["wavenumber"] / s)
        if self.equation == "eigen":
            return ck.Eigen(terms["count"])
        if self.equation == "biharmonic":
            return ck.Biharmonic(
                self.data(lambda x: (terms["c"] + terms["eigenvalue"] ** 2) * self.u.value(x), 4), c=terms["c"] / s**4
            )
        if self.equation == "elliptic":
            return ck.Elliptic(f, c=c, **self.coefficients())
        rate = lambda t: 1.5 * np.cos(3 * t)  # noqa: E731
        exact = self.law in EXACT
        load = lambda x, t: self.flow(self.local(x)) * self.growth(t) + self.exact(self.local(x)) * rate(t)  # noqa: E731
        start = lambda x: self.exact(self.local(x), 0.0)  # noqa: E731
        if self.equation == "heat":
            return ck.Heat(start, STEP * STEPS, STEP, f=load if exact else 0.0, kappa=s * s)
        faster = lambda x, t: load(x, t) + self.exact(self.local(x), t) ** 3  # noqa: E731
        return ck.ReactionDiffusion(start, lambda u: -(u**3), kappa=s * s, until=STEP * STEPS, step=STEP, f=faster)

    def coefficients(self) -> dict[str, Any]:
        """Return a and v of the elliptic equation."""
        found: dict[str, Any] = {}
        if "diffusivity" in self.terms:
            found["diffusivity"] = self.data(self.terms["diffusivity"].value)
        if "tensor" in self.terms:
            R = self.place.matrix
            found["diffusivity"] = R @ np.array(self.terms["tensor"]) @ R.T
        if "velocity" in self.terms:
            v = np.array(self.terms["velocity"])
            along = lambda x: self.place.direction(self.shape.projector(self.local(x)) @ v) / self.place.scale  # noqa: E731
            found["velocity"] = along
        return found

    def boundary(self, number: int, one: Curve | Pin) -> ck.Boundary:
        """Return a curve or point with its conditions."""
        source, towards = self.pin(one) if isinstance(one, Pin) else self.curve(one)
        left, _, right = one.condition.partition(",")
        name = f"{number + 1}"
        if left == "transmission":
            return ck.Boundary(
                name, source, across=ck.Transmission(jump=self.step * self.growth(0.0) if number == 0 else 0.0)
            )
        step = self.step if number == 0 else 0.0
        if not right and left == "dirichlet" and not step:
            return ck.Boundary(name, source, both=self.condition(left, towards, self.step * (number > 0)))
        sides = [
            self.condition(left, lambda x: -towards(x), step),
            self.condition(right or left, towards, 0.0),
        ]
        return ck.Boundary(name, source, left=sides[0], right=sides[1], left_of=self.left_of(one, towards))

    def left_of(self, one: Curve | Pin, towards: Field) -> Any:
        """Return a point of the scene on the left, where the source has no normals of its own."""
        if self.kind.split()[0] not in ("bare", "cloud"):
            return None
        at = self.shape.points(1, np.random.default_rng(one.seed)) if isinstance(one, Pin) else self.on_curve(one, 0.5)
        return self.place.world(at + 0.1 * towards(at))[0]

    def condition(self, name: str, out: Field, step: float | Field) -> Any:
        """Return a condition that the exact solution keeps; ``out`` is the local conormal, out of its side.

        There the solution is u and ``step``.
        """

        def value(x: Any) -> Any:
            return self.u.value(x) + (step(x) if callable(step) else step)

        def slope(x: Any) -> Any:
            return np.sum(self.u.gradient(x) * out(x), axis=1)

        if name == "dirichlet":
            return ck.Dirichlet(self.data(value))
        if name == "zero":
            return ck.Dirichlet(0.0)
        if name == "natural":
            return ck.Neumann(0.0)
        if name == "neumann":
            return ck.Neumann(self.data(slope, 1))
        return ck.Robin(1.0, BETA / self.place.scale, self.data(lambda x: slope(x) + BETA * value(x), 1))

    def pin(self, one: Pin) -> tuple[Any, Field]:
        """Return a point of the shape; on a curve the left is where it comes from."""
        at = self.shape.points(1, np.random.default_rng(one.seed))
        source = ck.source("analytic.point", at=self.place.world(at)[0])
        return source, lambda x: -self.shape.tangent(x)  # type: ignore[attr-defined]

    def on_curve(self, one: Curve, share: float) -> Any:
        """Return a local point (1, 3) of a curve."""
        if isinstance(self.shape, Plate):
            first, last = one.span or (-1.0, 1.0)
            return np.array([[first + share * (last - first), one.at, 0.0]])
        height, radius = self.shape.parallel(one.at)
        first, last = one.span or (0.0, 2 * np.pi)
        turn = first + share * (last - first)
        return np.array([[radius * np.cos(turn), radius * np.sin(turn), height]])

    def curve(self, one: Curve) -> tuple[Any, Field]:
        """Return a curve in the shape, and local conormals that point to its left."""
        across = lambda x: np.cross(self.shape.normal(x), self._travel(x))  # noqa: E731
        if isinstance(self.shape, Plate):
            ends = [self.on_curve(one, share)[0].tolist() for share in (0.0, 1.0)]
            return ck.source("analytic.segment", start=ends[0], end=ends[1], **self.place.keys), across
        height, radius = self.shape.parallel(one.at)
        keys = {"center": [0, 0, height], "normal": [0, 0, 1], "radius": radius, **self.place.keys}
        if one.span is None:
            return ck.source("analytic.circle", **keys), across
        return ck.source("analytic.arc", start=one.span[0], end=one.span[1], x_axis=[1, 0, 0], **keys), across

    def _travel(self, x: Any) -> Any:
        if isinstance(self.shape, Plate):
            return np.tile([1.0, 0.0, 0.0], (len(x), 1))
        return np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1) / np.linalg.norm(x[:, :2], axis=1)[:, None]


#: Laws whose cases have u as their exact solution.
EXACT = ("exact", "constant", "shift")
