"""The scenes of junctions.py, each at several positions, with the points at which errors are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import union_problems
from scipy.spatial.transform import Rotation
from union_problems import ROD, SPHERE, Problem

import cpmkit as ck

Function = Callable[[Any], Any]
CIRCLE = ck.source("analytic.circle")
DISK = ck.source("solid", of=CIRCLE)
#: A flat disk in space.
SHEET = ck.source("parametric.surface", x=["u*cos(v)", "u*sin(v)", "0*u"], u=[0, 1], v=[0, "2*pi"], periodic_v=True)
#: The angles in degrees of the ends of segments; None is the middle, in which all arms, of length 1, meet.
CURVES: dict[str, list[tuple[int | None, int]]] = {
    "T": [(180, 0), (None, 90)],
    "X": [(180, 0), (60, 240)],
    "star": [(None, 0), (None, 72), (None, 144), (None, 216), (None, 288)],
}
#: Steps of heat.
STEPS = 100
#: Data of an equation that are moved with the scene.
DATA = ("f", "diffusivity", "c", "initial")


@dataclass(frozen=True)
class Case:
    """A problem, and points on the members of each dimension."""

    name: str
    data: str
    problem: Problem
    points: Mapping[int, Any] = field(repr=False)

    @property
    def dim(self) -> int:
        """The dimension of space."""
        return int(self.problem.scene.surface.dim)

    def placed(self, position: int) -> tuple[ck.Scene, Any]:
        """Return the scene at a position and the matrix that turns it; at 0 and 1 it is along the axes."""
        scene, dim = self.problem.scene, self.dim
        any_turn = Rotation.random(random_state=np.random.default_rng(position)).as_rotvec()
        about_z = np.array([0, 0, [0.0, np.pi / 2, any_turn[2]][min(position, 2)]])
        vector = any_turn if dim == 3 and position > 1 else about_z
        turn = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
        source = ck.source("moved", of=scene.surface, rotation=float(vector[2]) if dim == 2 else vector)
        data = {name: moved_data(getattr(scene.problem, name, None), source, turn) for name in DATA}
        equation = replace(scene.problem, **{name: value for name, value in data.items() if value is not None})
        edge = moved_edge(scene.edge, turn)
        return ck.Scene(source, equation, edge=edge, junctions=scene.junctions), turn

    def origin(self, spacing: float, position: int) -> Any:
        """Return an origin of the lattice; at the first position planes of the lattice run through the scene."""
        return spacing * np.random.default_rng([position, 1]).uniform(size=self.dim) * (position > 0)

    def values(self, m: int) -> Any:
        """Return the exact values at the points on the members of dimension ``m``."""
        return self.problem.exact[m](self.points[m])

    @property
    def range(self) -> float:
        """The range of the exact values."""
        return float(np.ptp(np.concatenate([self.values(m) for m in self.problem.exact])))


def moved_data(data: Any, source: Any, turn: Any) -> Any:
    """Return data of a scene for the scene turned."""
    if isinstance(data, ck.MemberData):
        return ck.MemberData(source, [moved_data(value, source, turn) for value in data.values])
    return (lambda x: data(x @ turn)) if callable(data) else data


def moved_edge(edge: Any, turn: Any) -> Any:
    """Return what holds on the edge of a scene for the scene turned."""
    if isinstance(edge, Mapping):
        return {loop: moved_edge(condition, turn) for loop, condition in edge.items()}
    return ck.Dirichlet(moved_data(edge.value, None, turn)) if isinstance(edge, ck.Dirichlet) else edge


def ring(conductance: float) -> Case:
    """Return a sphere with its equator."""
    points = {1: union_problems.on_ring(), 2: union_problems.on_sphere()}
    problem = union_problems.ring_on_sphere(conductance)
    return Case("circle on a sphere", f"conductivity {conductance:g}", problem, points)


def line(conductance: float) -> Case:
    """Return a flat disk with its diameter: u = sin(x) + |y| exp(x / 2), v = sin(x), and c = 1."""
    both = ck.source("union", members=[SHEET, ck.source("analytic.segment", start=[-1.0, 0, 0], end=[1.0, 0, 0])])

    def side(x: Any) -> Any:
        return np.abs(x[:, 1]) * np.exp(x[:, 0] / 2)

    def of_disk(x: Any) -> Any:
        return 2 * np.sin(x[:, 0]) + 0.75 * side(x)

    def of_line(x: Any) -> Any:
        return (conductance + 1) * np.sin(x[:, 0]) - 2 * np.exp(x[:, 0] / 2)

    def u(x: Any) -> Any:
        return np.sin(x[:, 0]) + side(x)

    diffusivity = ck.MemberData(both, [1.0, conductance])
    equation = ck.Elliptic(f=ck.MemberData(both, [of_disk, of_line]), diffusivity=diffusivity, c=1.0)
    flat = union_problems.in_ball()[:, :2] @ np.eye(2, 3)
    along = np.linspace(-0.99, 0.99, 200)[:, None] * [1.0, 0, 0]
    problem = Problem(ck.Scene(both, equation, edge=ck.Dirichlet(u)), {1: u, 2: u})
    return Case("line across a flat disk", f"conductivity {conductance:g}", problem, {1: along, 2: flat})


def ball(resistance: float) -> Case:
    """Return a ball with its boundary."""
    points = {2: union_problems.on_sphere(), 3: union_problems.in_ball()}
    return Case("ball and boundary", f"resistance {resistance:g}", union_problems.exchange(resistance), points)


def disk(resistance: float) -> Case:
    """Return a disk in the plane with its boundary."""
    points = {1: union_problems.on_ring()[:, :2], 2: union_problems.in_ball()[:, :2]}
    problem = union_problems.exchange(resistance, DISK, CIRCLE)
    return Case("disk and boundary", f"resistance {resistance:g}", problem, points)


def vessel(radius: float) -> Case:
    """Return a ball with a circle inside, read on the circle and at more than .3 from it."""
    problem = union_problems.ring_in_ball(radius)
    circle, at = problem.scene.surface.members[1], union_problems.in_ball()
    feet = circle.closest_point(at)
    return Case("circle in a ball", f"radius {radius:g}", problem, {1: feet.points[:200], 3: at[feet.distance > 0.3]})


def rod(radius: float) -> Case:
    """Return a sphere with a rod, read on the rod half way and at .05 from the joint."""
    joint = union_problems.rod_on_sphere(radius)[0]
    scene = ck.Scene(
        ck.source("union", members=[SPHERE, ROD]),
        ck.ScreenedPoisson(0.0),
        edge={1001: ck.Dirichlet(1.0)},
        junctions=ck.Junction(radius=radius),
    )
    points = {1: np.array([[2.0, 0, 0], [1.05, 0, 0]])}
    exact = {1: lambda x: between(joint, 1.0, 2.0, x[:, 0] - 1)}
    return Case("rod on a sphere", f"radius {radius:g}", Problem(scene, exact), points)


def between(start: float, end: Any, length: float, s: Any) -> Any:
    """Return at ``s`` the solution of -v'' + v = 0 with its values at 0 and ``length``."""
    return (start * np.sinh(length - s) + end * np.sinh(s)) / np.sinh(length)


def end_values(x: Any) -> Any:
    """Return the values at the outer ends of curves."""
    return np.exp(x[:, 0]) + x[:, 1]


def on_circle(angle: int | None) -> Any:
    """Return the point (2,) of the unit circle at an angle in degrees, or the middle."""
    return np.zeros(2) if angle is None else np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])


def arms(name: str) -> Case:
    """Return arms of length 1 that meet in a point, of which what flows in flows out."""
    ends = np.array([on_circle(angle) for segment in CURVES[name] for angle in segment if angle is not None])
    middle = end_values(ends).sum() / (len(ends) * np.cosh(1.0))

    def v(x: Any) -> Any:
        nearest = (x @ ends.T).argmax(axis=1)
        return between(middle, end_values(ends)[nearest], 1.0, np.linalg.norm(x, axis=1))

    members = [ck.source("analytic.segment", start=on_circle(a), end=on_circle(b)) for a, b in CURVES[name]]
    points = (np.linspace(0.01, 0.99, 50)[:, None, None] * ends).reshape(-1, 2)
    scene = ck.Scene(ck.source("union", members=members), ck.ScreenedPoisson(0.0), edge=ck.Dirichlet(end_values))
    return Case(name, "values at the ends", Problem(scene, {1: v}), {1: points})


def spoke() -> Case:
    """Return a circle with a segment of length 1 outside, and 1 at its end."""
    joint = 1 / (np.cosh(1.0) + 2 * np.tanh(np.pi) * np.sinh(1.0))

    def v(x: Any) -> Any:
        away = np.maximum(np.linalg.norm(x, axis=1) - 1, 0)
        round_ = joint * np.cosh(np.pi - np.abs(np.arctan2(x[:, 1], x[:, 0]))) / np.cosh(np.pi)
        return np.where(away > 1e-9, between(joint, 1.0, 1.0, away), round_)

    both = ck.source("union", members=[CIRCLE, ck.source("analytic.segment", start=[1.0, 0], end=[2.0, 0])])
    scene = ck.Scene(both, ck.ScreenedPoisson(0.0), edge={1001: ck.Dirichlet(1.0)})
    angles = np.linspace(0, 2 * np.pi, 100)
    points = [np.stack([np.cos(angles), np.sin(angles)], axis=1), np.linspace(1.01, 2, 50)[:, None] * [1.0, 0]]
    return Case("spoke on a circle", "values at the ends", Problem(scene, {1: v}), {1: np.concatenate(points)})


def warm(case: Case) -> Case:
    """Return the members and junctions of a case with heat that starts near a point and does not leave."""
    initial = partial(hill, at=np.eye(1, case.dim)[0])
    heat = ck.Heat(initial=initial, until=1.0, step=1 / STEPS, frames=10)
    scene = ck.Scene(case.problem.scene.surface, heat, junctions=case.problem.scene.junctions)
    return replace(case, data=f"total of heat, {STEPS} steps", problem=Problem(scene, {}))


def hill(x: Any, at: Any) -> Any:
    return np.exp(-4 * np.sum((x - at) ** 2, axis=1))
