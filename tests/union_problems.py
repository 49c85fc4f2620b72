"""Problems with known solutions on unions of members of different dimension."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

import cpmkit as ck
from cpmkit.types import Floats

SPHERE = ck.source("analytic.sphere")
BALL = ck.source("solid", of=SPHERE)
RING = ck.source("analytic.circle", normal=[0, 0, 1])
ROD = ck.source("analytic.segment", start=[1.0, 0, 0], end=[3.0, 0, 0])
VESSEL = ck.source("analytic.segment", start=[-0.5, 0.1, 0.05], end=[0.6, 0.0, 0.8])  # from inside to the skin


@dataclass(frozen=True)
class Problem:
    """A scene, and its exact solution on the members of each dimension."""

    scene: ck.Scene
    exact: dict[int, Callable[[Floats], Floats]]

    def largest_error(self, solution, points) -> float:
        """Return the largest error at ``points``, arrays (n, d) by the dimension of the members."""
        return max(
            np.abs(solution.of_dimension(m).evaluate(points[m]) - u(points[m])).max() for m, u in self.exact.items()
        )


def on_sphere(count: int = 2000) -> Floats:
    """Return points (n, 3) of the unit sphere."""
    x = np.random.default_rng(0).normal(size=(count, 3))
    return x / np.linalg.norm(x, axis=1)[:, None]


def in_ball(count: int = 2000) -> Floats:
    """Return points (n, 3) of the unit ball."""
    return on_sphere(count) * np.random.default_rng(1).uniform(0, 0.98, (count, 1)) ** (1 / 3)


def on_ring(count: int = 200) -> Floats:
    """Return points (n, 3) of the unit circle around the z axis."""
    t = np.linspace(0, 6, count)
    return np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)


def ring_on_sphere(conductance: float) -> Problem:
    """u = x + |z| on the sphere and v = x on its equator, whose conductivity is ``conductance``, with c = 1.

    Each side of the equator gives the slope 1 to it.
    """
    both = ck.source("union", members=[SPHERE, RING])
    f = ck.MemberData(both, [lambda x: 3 * (x[:, 0] + np.abs(x[:, 2])), lambda x: (conductance + 1) * x[:, 0] - 2])
    problem = ck.Elliptic(f=f, diffusivity=ck.MemberData(both, [1.0, conductance]), c=1.0)
    return Problem(ck.Scene(both, problem), {1: lambda x: x[:, 0], 2: lambda x: x[:, 0] + np.abs(x[:, 2])})


def exchange(resistance: float, bulk=BALL, surface=SPHERE) -> Problem:
    """u = x + .3 exp(y) in the unit ball or disc, v = u + R du/dn on its boundary, c = 1, and their exchange."""
    both = ck.source("union", members=[bulk, surface])
    m, r = surface.manifold_dim, resistance

    def u(x):
        return x[:, 0] + 0.3 * np.exp(x[:, 1])

    def slope(x):
        return x[:, 0] + 0.3 * np.exp(x[:, 1]) * x[:, 1]

    def v(x):
        return (1 + r) * x[:, 0] + 0.3 * np.exp(x[:, 1]) * (1 + r * x[:, 1])

    def of_surface(x):
        """-Lap v + v + du/dn; of a function g of y alone Lap g is (1 - y^2) g'' - m y g'."""
        y, e = x[:, 1], 0.3 * np.exp(x[:, 1])
        first, second = e * (1 + r * y + r), e * (1 + r * y + 2 * r)
        return m * (1 + r) * x[:, 0] - (1 - y**2) * second + m * y * first + v(x) + slope(x)

    f = ck.MemberData(both, [lambda x: x[:, 0], of_surface])
    scene = ck.Scene(both, ck.ScreenedPoisson(f), junctions=ck.Junction(resistance=r))
    return Problem(scene, {m: v, m + 1: u})


def ring_in_ball(radius: float) -> Problem:
    """A circle of radius .5 gives 1 per length to a ball, whose skin has the values of the circle's potential.

    v is the mean of u around the circle at the distance ``radius``.
    """
    from scipy.special import ellipk

    size, centre = 0.5, np.array([0.013, -0.021, 0.037])
    normal = np.array([0.2, 0.3, 1.0]) / np.linalg.norm([0.2, 0.3, 1.0])

    def u(x):
        height = (x - centre) @ normal
        distance = np.linalg.norm(x - centre - height[:, None] * normal, axis=1)
        square = (size + distance) ** 2 + height**2
        return size * ellipk(4 * size * distance / square) / (np.pi * np.sqrt(square))

    first = np.cross(normal, [1.0, 0, 0]) / np.linalg.norm(np.cross(normal, [1.0, 0, 0]))
    angle = 2 * np.pi * (np.arange(64) + 0.5) / 64
    around = centre + (size + radius * np.cos(angle))[:, None] * first + radius * np.sin(angle)[:, None] * normal
    circle = ck.source("analytic.circle", center=centre, normal=normal, radius=size)
    both = ck.source("union", members=[BALL, circle])
    problem = ck.Elliptic(f=ck.MemberData(both, [0.0, 1.0]))
    scene = ck.Scene(both, problem, edge={0: ck.Dirichlet(u)}, junctions=ck.Junction(radius=radius))
    value = u(around).mean()
    return Problem(scene, {1: lambda x: np.full(len(x), value), 3: u})


@cache
def rod_on_sphere(radius: float) -> tuple[float, float, float]:
    """Return v at the joint and half way along the rod, and u opposite on the sphere, for c = 1 and 1 at the rod's end.

    The rod ends on a circle of ``radius`` on the sphere. Both are solved as ordinary differential equations.
    """
    from scipy.integrate import solve_ivp

    start, angle = 1e-6, 2 * np.arcsin(radius / 2)

    def legendre(t, y):
        return [y[1], y[0] - y[1] / np.tan(t)]

    solution = solve_ivp(legendre, [np.pi - start, angle], [1.0, -start / 2], rtol=1e-11, atol=1e-13)
    value, slope = solution.y[:, -1]
    flow = -2 * np.pi * np.sin(angle) * slope
    size = 1 / (value * np.cosh(2) + flow * np.sinh(2))
    return size * value, size * (value * np.cosh(1) + flow * np.sinh(1)), size
