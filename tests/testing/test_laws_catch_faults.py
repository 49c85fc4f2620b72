"""Every law of the conformance kit catches a source that breaks it, and passes one that keeps them all."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from cpmkit import plugins
from cpmkit.plugin import Advice, ClosestPoints, as_points, positive
from cpmkit.testing import LAWS, ConformanceCase, installed_cases, kinds_without_case, parametrize_with_laws, run_laws


def on_circle(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def directions(x: np.ndarray) -> np.ndarray:
    length = np.hypot(*x.T)[:, None]
    return np.where(length > 1e-100, x, [1.0, 0.0]) / np.where(length > 1e-100, length, 1.0)


@dataclass(frozen=True, eq=False)
class Circle:
    """A unit circle without faults and with every ability; its data are its value at one vertex."""

    center: np.ndarray = field(default_factory=lambda: np.zeros(2))
    exact: bool = True
    dim: int = 2
    manifold_dim: int = 1
    value_count: int = 1

    @property
    def bounds(self) -> np.ndarray:
        return np.stack([self.center - 1.0, self.center + 1.0])

    def nearest(self, x: np.ndarray) -> np.ndarray:
        return self.center + directions(x - self.center)

    def closest_point(self, x: np.ndarray) -> ClosestPoints:
        x = as_points(x, 2)
        points = self.nearest(x)
        return ClosestPoints(points, np.linalg.norm(x - points, axis=1), np.full(len(x), -1))

    def local_minima(self, x: np.ndarray, radius: float) -> tuple[np.ndarray, ClosestPoints]:
        found = self.closest_point(x)
        rows = np.flatnonzero(found.distance <= positive(radius, "radius"))
        return rows, found.take(rows)

    def normals(self, feet: ClosestPoints) -> np.ndarray:
        return directions(feet.points - self.center)

    def facet_normals(self, feet: ClosestPoints) -> np.ndarray:
        return np.where(feet.points[:, :1] > self.center[0], self.normals(feet), np.nan)

    def closest_point_and_inside(self, x: np.ndarray) -> tuple[ClosestPoints, np.ndarray]:
        return self.closest_point(x), np.linalg.norm(x - self.center, axis=1) <= 1.0

    def tangents(self, feet: ClosestPoints) -> np.ndarray:
        return directions(feet.points - self.center)[:, ::-1] * [-1.0, 1.0]

    def interpolate(self, values: np.ndarray, feet: ClosestPoints) -> np.ndarray:
        return np.repeat(values, len(feet), axis=0)

    def mesh(self, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        count = 3 + int(2 * np.pi / spacing)
        start = np.arange(count)
        return self.center + on_circle(2 * np.pi * start / count), np.stack([start, (start + 1) % count], axis=1)

    def advice(self, spacing: float) -> Advice:
        return Advice(1e-16, () if spacing < 1.0 else (f"At the spacing {spacing:.1f} a circle is a polygon.",))

    def translate(self, offset: np.ndarray) -> Circle:
        return replace(self, center=self.center + offset)


class FlatBounds(Circle):
    @property
    def bounds(self):
        return super().bounds[::-1]


class SinglePrecision(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, edge=feet.edge.astype(np.int32))


class NothingForNothing(Circle):
    def closest_point(self, x):
        return super().closest_point(x) if len(x) else ClosestPoints(x[:, :1], x[:, 0], np.empty(0, int))


class Scribbler(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        x[:] = feet.points
        return feet


class SortsItsBatch(Circle):
    def nearest(self, x):
        return super().nearest(x + 1e-8 * (x.mean(axis=0) if len(x) else 0))


class NaNAtTheCentre(Circle):
    def nearest(self, x):
        length = np.hypot(*(x - self.center).T)[:, None]
        return np.where(length == 0, np.nan, super().nearest(x))


class AnswersNaN(Circle):
    def closest_point(self, x):
        x = np.nan_to_num(np.asarray(x, dtype=float), posinf=0, neginf=0)
        return super().closest_point(x)


class RaisesValueError(Circle):
    def closest_point(self, x):
        if np.ndim(x) != 2 or np.shape(x)[1] != 2:
            raise ValueError("bad shape")
        return super().closest_point(x)


class TooManyEnds(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, edge=np.where(x[:, 0] > 1.0, 2, -1))


class HalfWay(Circle):
    """Takes one step of Newton's method towards |x|^2 = 1 where it is near."""

    def nearest(self, x):
        y = x - self.center
        excess = (y**2).sum(axis=1)[:, None] - 1
        return np.where(np.abs(excess) < 0.5, x - 0.5 * excess * y / np.maximum(1 + excess, 0.5), super().nearest(x))


class SquaredDistance(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, distance=feet.distance**2)


class DistanceTooLarge(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, distance=feet.distance * 1.0001)


class Farthest(Circle):
    def nearest(self, x):
        y = x - self.center
        return self.center + directions(y) * np.where(np.hypot(*y.T)[:, None] < 0.3, -1.0, 1.0)


class SlidingFoot(Circle):
    """Claims feet within 0.1 x distance, and gives some twice as far away as the nearest."""

    def nearest(self, x):
        return self.center + directions((x - self.center) * [1.0, 3.0])

    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, distance=np.abs(np.hypot(*(np.asarray(x) - self.center).T) - 1.0))


class FarSideOfTheDiagonals(Circle):
    def nearest(self, x):
        relative = x - self.center
        on_diagonal = np.abs(relative[:, :1]) == np.abs(relative[:, 1:])
        return self.center + directions(np.where(on_diagonal, -relative, relative))


class CentreIsItsOwnFoot(Circle):
    def nearest(self, x):
        return np.where(np.hypot(*(x - self.center).T)[:, None] < 1e-6, x, super().nearest(x))


class SmallBounds(Circle):
    @property
    def bounds(self):
        return 0.9 * super().bounds


class NormalsAlongTheCurve(Circle):
    def normals(self, feet):
        return super().tangents(feet)


class NormalsTowardsTheQuery(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, local=np.sign(np.hypot(*(x - self.center).T) - 1.0)[:, None])

    def normals(self, feet):
        return super().normals(feet) * np.where(feet.local == 0, 1.0, feet.local)


class LongFacetNormals(Circle):
    def facet_normals(self, feet):
        return 2 * super().facet_normals(feet)


class FacetNormalsUnknownInPart(Circle):
    def facet_normals(self, feet):
        return np.where([True, False], super().normals(feet), np.nan)


class Everted(Circle):
    def closest_point_and_inside(self, x):
        feet, inside = super().closest_point_and_inside(x)
        return feet, ~inside


class InsideOnTheRightAlone(Circle):
    def closest_point_and_inside(self, x):
        feet, inside = super().closest_point_and_inside(x)
        return feet, inside & (x[:, 0] > self.center[0])


class InsideByNumbers(Circle):
    def closest_point_and_inside(self, x):
        feet, inside = super().closest_point_and_inside(x)
        return feet, inside.astype(int)


class FeetOfItsOwn(Circle):
    def closest_point_and_inside(self, x):
        feet, inside = super().closest_point_and_inside(x)
        return replace(feet, points=-feet.points), inside


class LongTangents(Circle):
    def tangents(self, feet):
        return 2 * super().tangents(feet)


class TangentsAcrossTheCurve(Circle):
    def tangents(self, feet):
        return super().normals(feet)


class ZeroData(Circle):
    def interpolate(self, values, feet):
        return np.zeros((len(feet), 2))


class MeshOffTheCurve(Circle):
    def mesh(self, spacing):
        vertices, cells = super().mesh(spacing)
        return 1.001 * vertices, cells


class MeshWithoutWrap(Circle):
    def mesh(self, spacing):
        vertices, cells = super().mesh(spacing)
        return vertices, cells + 1


class MeshOfTriangles(Circle):
    def mesh(self, spacing):
        vertices, cells = super().mesh(spacing)
        return vertices, np.stack([cells[:, 0], cells[:, 1], (cells[:, 1] + 1) % len(vertices)], axis=1)


class PaddedMesh(Circle):
    def mesh(self, spacing):
        vertices, cells = super().mesh(spacing)
        return vertices, np.pad(cells, ((0, 0), (0, 1)), constant_values=-1)


class HalfMesh(Circle):
    def mesh(self, spacing):
        vertices, cells = super().mesh(spacing)
        return vertices, cells[: len(cells) // 2]


class MeshOfThreeSegments(Circle):
    def mesh(self, spacing):
        return super().mesh(10.0)


class SkinIsAnArea(Circle):
    @property
    def skin(self) -> Circle:
        return Circle(self.center, manifold_dim=2)


class WithSecondFeet(Circle):
    """Adds, for queries near the middle, another foot to each: of these ``second`` are the points."""

    def local_minima(self, x, radius):
        rows, found = super().local_minima(x, radius)
        more = np.flatnonzero(np.isin(np.arange(len(x)), rows) & (np.hypot(*(x - self.center).T) < 0.5))
        points = self.second(x[more])
        further = ClosestPoints(points, np.linalg.norm(x[more] - points, axis=1), np.full(len(more), -1))
        rows = np.concatenate([rows, more])
        both = ClosestPoints.join([found, further])
        order = np.lexsort((both.distance, rows))
        keep = order[both.distance[order] <= radius]
        return rows[keep], both.take(keep)


class FeetTwice(WithSecondFeet):
    def second(self, x):
        return self.nearest(x)


class FarthestFeetToo(WithSecondFeet):
    def second(self, x):
        return 2 * self.center - self.nearest(x)


class FeetBeside(WithSecondFeet):
    def second(self, x):
        beside = self.nearest(x) - self.center
        return self.center + directions(beside + 0.3 * beside[:, ::-1] * [-1.0, 1.0])


class FeetOffTheCurve(WithSecondFeet):
    def second(self, x):
        return self.center + 1.01 * (self.nearest(x) - self.center)


class AllFeetHaveRowZero(Circle):
    def local_minima(self, x, radius):
        rows, found = super().local_minima(x, radius)
        return 0 * rows, found


class FeetOfAnyRadius(Circle):
    def local_minima(self, x, radius):
        return super().local_minima(x, 1e3 * radius)


class FeetOfNothing(Circle):
    def local_minima(self, x, radius):
        rows, found = super().local_minima(x, abs(radius) + 1e-9 if radius == radius else 1.0)
        return rows, found


class WarnsOfNothing(Circle):
    def advice(self, spacing):
        return Advice(warnings=(None,))


class WarnsInTwoSentences(Circle):
    def advice(self, spacing):
        return Advice(warnings=("It is coarse. Take a smaller spacing.",))


class WarnsWithoutEnd(Circle):
    def advice(self, spacing):
        return Advice(warnings=("It is coarse",))


class FloorBelowZero(Circle):
    def advice(self, spacing):
        return Advice(-1e-3)


class FloorOfNothing(Circle):
    def advice(self, spacing):
        return Advice(float("nan") if spacing < 0.1 else 0.1)


class TranslatedTheOtherWay(Circle):
    def translate(self, offset):
        return replace(self, center=self.center - offset)


class TranslationLosesAbilities(Circle):
    def translate(self, offset):
        whole = super().translate(offset)

        class Bare:
            dim, manifold_dim, exact, bounds = 2, 1, True, whole.bounds
            closest_point = whole.closest_point
            translate = whole.translate

        return Bare()


class LeftAlongTheCurve(Circle):
    def leftward(self, feet):
        return self.tangents(feet)


class PointOnTheRight(Circle):
    left_of = np.array([1e3, 0.0])

    def leftward(self, feet):
        return -self.normals(feet)


class ThousandthEdge(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, edge=np.full(len(feet), 1000))


class EndsWithoutNumber(Circle):
    """The upper half of the circle; its two ends are on no edge."""

    def nearest(self, x):
        y = x - self.center
        return self.center + directions(np.where(y[:, 1:] > 0, y, np.where(y[:, :1] < 0, [-1.0, 0.0], [1.0, 0.0])))


class NumberedEnds(EndsWithoutNumber):
    def closest_point(self, x):
        feet = super().closest_point(x)
        below = feet.points[:, 1] <= self.center[1]
        return replace(feet, edge=np.where(below, (feet.points[:, 0] < self.center[0]).astype(int), -1))


class EdgeEverywhere(Circle):
    def closest_point(self, x):
        feet = super().closest_point(x)
        return replace(feet, edge=np.zeros(len(feet), dtype=int))


class OddLimit(Circle):
    edge_limit = 1001


class TwoFeet(Circle):
    def advice(self, spacing):
        return Advice(foot_count=2)


FAULTS = {
    "finite_feet": [TwoFeet],
    "left": [LeftAlongTheCurve, PointOnTheRight],
    "statement": [FlatBounds],
    "shapes": [SinglePrecision, NothingForNothing, NaNAtTheCentre],
    "input_untouched": [Scribbler],
    "batches": [SortsItsBatch],
    "bad_input": [AnswersNaN, RaisesValueError],
    "rims": [EndsWithoutNumber, EdgeEverywhere],
    "edge": [TooManyEnds, ThousandthEdge, OddLimit],
    "idempotence": [HalfWay],
    "lipschitz": [SquaredDistance],
    "distance": [DistanceTooLarge, SquaredDistance],
    "nearest": [Farthest],
    "foot": [SlidingFoot],
    "degenerate": [CentreIsItsOwnFoot, NaNAtTheCentre, FarSideOfTheDiagonals],
    "bounds": [SmallBounds],
    "normals": [NormalsAlongTheCurve, NormalsTowardsTheQuery],
    "facet_normals": [LongFacetNormals, FacetNormalsUnknownInPart],
    "inside": [Everted, InsideOnTheRightAlone, InsideByNumbers, FeetOfItsOwn],
    "tangents": [LongTangents, TangentsAcrossTheCurve],
    "values": [ZeroData],
    "mesh": [MeshOffTheCurve, MeshWithoutWrap, MeshOfTriangles, PaddedMesh],
    "mesh_covers": [HalfMesh, MeshOfThreeSegments],
    "advice": [WarnsOfNothing, WarnsInTwoSentences, WarnsWithoutEnd, FloorBelowZero, FloorOfNothing],
    "local_minima": [FeetOffTheCurve, AllFeetHaveRowZero, FeetOfAnyRadius],
    "sheets": [FeetTwice, FarthestFeetToo, FeetBeside],
    "bad_radius": [FeetOfNothing],
    "skin": [SkinIsAnArea],
    "translation": [TranslatedTheOtherWay, TranslationLosesAbilities],
}


def case(source: type[Circle], samples: bool = True) -> ConformanceCase:
    exact = source is not SlidingFoot
    draw = (lambda rng, n: on_circle(rng.uniform(0, 2 * np.pi, n))) if samples else None
    return ConformanceCase(
        "test.circle", source.__name__, lambda: source(exact=exact), draw, turning_angle=0.0 if exact else 0.1
    )


def test_a_source_without_faults_keeps_all_laws() -> None:
    run_laws(case(Circle))
    run_laws(case(Circle, samples=False))


def test_ends_that_have_numbers_keep_the_law_of_rims() -> None:
    next(law for law in LAWS if law.__name__ == "check_rims")(case(NumberedEnds, samples=False))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_each_law_catches_its_faults_and_names_them(law) -> None:
    for fault in FAULTS[law.__name__.removeprefix("check_")]:
        with pytest.raises(AssertionError) as caught:
            law(case(fault))
        message = str(caught.value)
        assert message.startswith(f"test.circle ({fault.__name__}) breaks the law {law.__name__} (")


@pytest.mark.parametrize(
    ("cells", "manifold_dim", "fault"),
    [
        ([[0, 1, 2], [0, 1, -1], [3, -1, -1]], None, None),
        ([[0, 1], [1, 2]], None, None),
        ([[0, 1, 2]], 2, None),
        ([[0], [1]], 1, None),
        ([[0], [1]], 2, None),
        ([[0, 1, 2], [0, 1, -1]], 2, "although the manifold has one dimension, 2"),
        ([[0, 1]], 2, "Cells of a manifold of dimension 2 have 2 corners"),
        ([[0, 1, -1], [3, -1, -1]], None, "No cell has 3 corners"),
        ([[0, 1, 2], [0, -1, 1]], None, "goes on after -1"),
        ([[0, 1, 2], [-1, -1, -1]], None, "has a negative corner, or none"),
        ([[0, 1, 2], [0, 1, -2]], None, "has a negative corner, or none"),
        ([[0, 1, 2], [0, 0, -1]], None, "names a vertex twice"),
        ([[0, 1, 2], [0, 99, -1]], None, "names a vertex that is not there"),
    ],
)
def test_rows_of_a_mesh_are_shorter_only_where_dimensions_are_mixed(cells, manifold_dim, fault) -> None:
    class Meshed(Circle):
        def mesh(self, spacing):
            return super().mesh(1.0)[0], np.array(cells)

    law = next(law for law in LAWS if law.__name__ == "check_mesh")
    drawn = ConformanceCase("test.circle", "meshed", lambda: Meshed(manifold_dim=manifold_dim))
    if fault is None:
        law(drawn)
        return
    with pytest.raises(AssertionError, match=fault):
        law(drawn)


def test_a_foot_that_is_not_nearest_is_caught_without_samples() -> None:
    law = next(law for law in LAWS if law.__name__ == "check_nearest")
    with pytest.raises(AssertionError, match="at the query"):
        law(case(Farthest, samples=False))


def test_another_error_says_under_which_law_and_case_it_was_raised() -> None:
    class Crashes(Circle):
        def nearest(self, x):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as caught:
        run_laws(case(Crashes))
    assert any("test.circle (Crashes)" in note for note in caught.value.__notes__)


def test_the_decorator_makes_one_test_a_case_and_law() -> None:
    @parametrize_with_laws([case(Circle), case(Circle, samples=False)])
    def keeps(case, law):
        law(case)

    (mark,) = keeps.pytestmark
    assert len(mark.args[1]) == 2 * len(LAWS)


class PluginWithoutCase:
    @staticmethod
    def cpmkit_sources():
        return {"test.circle": Circle, "test.other": Circle}

    @staticmethod
    def cpmkit_conformance_cases():
        return [case(Circle)]


class SolverPlugin:
    @staticmethod
    def cpmkit_solvers():
        return {"test.solver": object}


def test_a_source_kind_without_case_is_named_and_a_solver_needs_none(monkeypatch: pytest.MonkeyPatch) -> None:
    offered = {"test.circle": PluginWithoutCase, "test.other": PluginWithoutCase, "test.solver": SolverPlugin}
    kinds = [plugins.InstalledKind(kind, "test", "1", "test") for kind in offered]
    monkeypatch.setattr(plugins, "installed_kinds", lambda: kinds)
    monkeypatch.setattr(plugins, "load_plugin", offered.__getitem__)
    assert kinds_without_case() == ["test.other"]
    assert [case.kind for case in installed_cases()] == ["test.circle"]
