"""Every combination passes every ability on with right values, or says in the table why it does not."""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from cpmkit_combinations.wrapper import ABILITIES, PassingRules

import cpmkit as ck
from cpmkit import plugin

KINDS = [field.name for field in fields(PassingRules)]
SHIFT, TURN, SCALE = np.array([3.0, -2.0]), 0.7, 2.0
ROTATION = np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])
VALUES = np.array([[1.0, 5.0], [2.0, 3.0]])


@dataclass(frozen=True, eq=False)
class Able:
    """A circle of the plane that can do everything a source may."""

    center: np.ndarray
    radius: float = 1.0

    dim, manifold_dim, exact, value_count, edge_limit = 2, 1, True, 2, 3000

    @property
    def bounds(self):
        return np.stack([self.center - self.radius, self.center + self.radius])

    @property
    def left_of(self):
        return self.center + [0.0, -0.5 * self.radius]

    def closest_point(self, x, /):
        return ck.source("analytic.circle", center=self.center, radius=self.radius).closest_point(x)

    def local_minima(self, x, radius, /):
        feet = self.closest_point(x)
        rows = np.flatnonzero(feet.distance <= radius)
        return rows, feet.take(rows)

    def normals(self, feet, /):
        return (feet.points - self.center) / self.radius

    def facet_normals(self, feet, /):
        return np.where(feet.points[:, :1] > self.center[0], self.normals(feet), np.nan)

    def closest_point_and_inside(self, x, /):
        return self.closest_point(x), np.linalg.norm(x - self.center, axis=1) <= self.radius

    def tangents(self, feet, /):
        n = self.normals(feet)
        return np.stack([-n[:, 1], n[:, 0]], axis=1)

    def leftward(self, feet, /):
        return -self.normals(feet)

    def interpolate(self, values, feet, /):
        share = 0.5 + 0.5 * self.normals(feet)[:, :1]
        return share * values[0] + (1 - share) * values[1]

    def mesh(self, spacing, /):
        t = np.linspace(0, 2 * np.pi, 100, endpoint=False)
        cells = np.stack([np.arange(100), (np.arange(100) + 1) % 100], axis=1)
        return self.center + self.radius * np.stack([np.cos(t), np.sin(t)], axis=1), cells

    @property
    def given_mesh(self):
        return self.mesh(0.1)

    def smooth_surface(self):
        return self

    def translate(self, offset, /):
        return replace(self, center=self.center + offset)

    def advice(self, spacing, /):
        target = f"The circle was asked at {spacing:g}."
        return plugin.Advice(1e-3 * spacing, (target,), 1e-4 * spacing, (target,), foot_count=7)


class Pair(Able):
    """The same, called a union of one."""

    @property
    def members(self):
        return [Able(self.center, self.radius)]

    def with_members(self, numbers, /):
        (number,) = numbers
        return self.members[number]

    def closest_point(self, x, /):
        return replace(super().closest_point(x), element=np.zeros(len(x), dtype=np.int64))


FIRST, SECOND = Able(np.zeros(2)), Able(np.array([5.0, 1.0]), 0.5)
QUERIES = np.random.default_rng(4).uniform(-1.2, 1.2, (40, 2)) - [0.0, 1.0]


def made(kind, of=FIRST):
    """Return the combination, a map of vectors, a map of points, the scale, and the source that is asked."""
    if kind == "moved":
        source = ck.source("moved", of=of, rotation=TURN, translation=SHIFT, scale=SCALE)
        return source, lambda v: v @ ROTATION.T, lambda p: SCALE * p @ ROTATION.T + SHIFT, SCALE
    if kind == "union":
        return ck.source("union", members=[SECOND, of]), np.asarray, np.asarray, 1.0
    keys = {"trim": "y"} if kind == "trimmed" else {}
    return ck.source(kind, of=of, **keys), np.asarray, np.asarray, 1.0


def test_the_table_answers_for_every_ability():
    rules = [getattr(passing, kind) for passing in ABILITIES.values() for kind in KINDS]
    assert all(len(rule) > 20 for rule in rules if isinstance(rule, str))
    assert all(rule.__doc__ for rule in rules if not isinstance(rule, str))
    names = [name for name in plugin.USES["Abilities of sources"] if name.startswith("Has")]
    assert set(ABILITIES) == {getattr(plugin, name) for name in names}


@pytest.mark.parametrize("ability", ABILITIES, ids=lambda ability: ability.__name__)
@pytest.mark.parametrize("kind", KINDS)
def test_a_combination_has_an_ability_or_says_why_not(kind, ability):
    having = {plugin.HasMembers: Pair(np.zeros(2)), plugin.HasSkin: ck.source("solid", of=FIRST)}
    of = having.get(ability, FIRST) if kind == "moved" else FIRST
    assert isinstance(made(kind, of)[0], ability) == (not isinstance(getattr(ABILITIES[ability], kind), str))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "solid"])
@pytest.mark.parametrize("name", ["normals", "facet_normals", "tangents", "leftward", "interpolate"])
def test_directions_and_values_are_those_of_the_source(kind, name):
    source, turned, placed, _ = made(kind)
    if kind == "union" and name == "interpolate":
        return  # the table says why not
    own = FIRST.closest_point(QUERIES)
    feet = source.closest_point(placed(QUERIES))
    kept = np.flatnonzero(np.linalg.norm(feet.points - placed(own.points), axis=1) < 1e-9)
    assert len(kept) > 20
    if name == "interpolate":
        got, want = source.interpolate(VALUES, feet), FIRST.interpolate(VALUES, own)
    else:
        got, want = getattr(source, name)(feet), turned(getattr(FIRST, name)(own))
    np.testing.assert_allclose(got[kept], want[kept], atol=1e-9)


def test_what_is_inside_is_moved():
    source, _, placed, _ = made("moved")
    feet, inside = source.closest_point_and_inside(placed(QUERIES))
    own, expected = FIRST.closest_point_and_inside(QUERIES)
    assert feet.points == pytest.approx(placed(own.points))
    assert inside.tolist() == expected.tolist()
    assert 0 < inside.sum() < len(inside)


def test_the_point_on_the_left_is_moved_and_is_dropped_with_what_it_is_left_of():
    moved, _, placed, _ = made("moved")
    assert moved.left_of == pytest.approx(placed(FIRST.left_of[None])[0])
    assert made("trimmed")[0].left_of == pytest.approx(FIRST.left_of)
    assert ck.source("trimmed", of=FIRST, trim="-y").left_of is None


@pytest.mark.parametrize("kind", KINDS)
def test_meshes_and_translations_are_those_of_the_source(kind):
    source, _, placed, _ = made(kind)
    offset = np.array([0.5, 7.0])
    there = source.translate(offset)
    x = placed(QUERIES)
    assert there.closest_point(x + offset).points == pytest.approx(source.closest_point(x).points + offset)
    assert all(isinstance(there, one) == isinstance(source, one) for one in ABILITIES)
    assert source.closest_point(source.mesh(0.1)[0]).distance.max() < 1e-9


@pytest.mark.parametrize("kind", ["moved", "trimmed"])
def test_given_meshes_are_those_of_the_source(kind):
    source, _, placed, _ = made(kind)
    vertices, cells = source.given_mesh
    assert vertices == pytest.approx(placed(FIRST.given_mesh[0]))
    assert np.array_equal(cells, FIRST.given_mesh[1])


@pytest.mark.parametrize("kind", KINDS)
def test_warnings_and_floors_are_those_at_the_spacing_of_the_source(kind):
    source, _, _, scale = made(kind)
    advice = source.advice(0.1)
    assert advice.floor == pytest.approx(1e-4 / scale)
    assert advice.integral_floor == pytest.approx(1e-5 / scale)
    for told in (advice.warnings, advice.closest_point_warnings):
        assert told[-1] == f"The circle was asked at {0.1 / scale:g}."


@pytest.mark.parametrize("kind", ["moved", "union"])
def test_further_feet_are_found_within_the_radius(kind):
    source, _, placed, scale = made(kind)
    rows, feet = source.local_minima(placed(QUERIES), 0.3 * scale)
    own_rows, own = FIRST.local_minima(QUERIES, 0.3)
    assert rows.tolist() == own_rows.tolist()
    assert feet.points == pytest.approx(placed(own.points))


def test_a_wrapper_has_no_more_than_its_sources_and_a_mixed_union_leaves_directions_to_its_members():
    point = ck.source("analytic.point", at=[9.0, 9.0])
    for kind in KINDS[:3]:
        has = {ability for ability in ABILITIES if isinstance(made(kind, ck.source("analytic.circle"))[0], ability)}
        assert not has & {plugin.HasLeft, plugin.HasValues}
        assert {plugin.HasNormals, plugin.HasMesh, plugin.HasTranslation} <= has
    mixed, alike = (ck.source("union", members=[FIRST, one]) for one in (point, SECOND))
    lost = {ability for ability in ABILITIES if isinstance(alike, ability) > isinstance(mixed, ability)}
    directions = {plugin.HasNormals, plugin.HasCreases, plugin.HasTangents, plugin.HasLeft}
    assert lost == {*directions, plugin.HasLocalMinima}


def test_members_move():
    moved, _, placed, _ = made("moved", Pair(np.zeros(2)))
    assert moved.members[0].closest_point(placed(QUERIES)).points == pytest.approx(
        placed(FIRST.closest_point(QUERIES).points)
    )


def test_edges_have_numbers_of_their_own_however_unions_are_nested():
    """A ring and a disc were both loop 1000."""
    circle = {r: ck.source("analytic.circle", radius=r) for r in (1.0, 0.4)}
    ring = ck.source("solid", of=ck.source("union", members=list(circle.values())))
    disc = ck.source("moved", of=ck.source("solid", of=circle[0.4]), translation=[4.0, 0.0])
    at = {"outer": [0.0, 1.5], "hole": [0.1, 0.0], "disc": [5.0, 0.0]}
    for members in ([ring, disc], [disc, ring], [ck.source("moved", of=ring), disc]):
        both = ck.source("union", members=members)
        numbers = both.closest_point(np.array(list(at.values()))).edge
        assert len(set(numbers.tolist())) == 3
        assert (numbers >= 0).all()
        assert numbers.max() < both.edge_limit
    rims = dict(zip(numbers.tolist(), (0.0, 1.0, 5.0), strict=True))
    conditions = {number: ck.Dirichlet(value) for number, value in rims.items()}
    solution = ck.solve(ck.Scene(both, ck.Laplace(), edge=conditions), 0.1)
    assert solution.evaluate([[4.0, 0.0]]) == pytest.approx([5.0])
    assert solution.evaluate([[0.7, 0.0]]) == pytest.approx([np.log(1 / 0.7) / np.log(1 / 0.4)], abs=0.02)


def test_rims_of_trimmed_unions_do_not_collide():
    bowls = [ck.source("moved", of=ck.source("analytic.cap", height=-0.5), translation=[x, 0, 0]) for x in (0.0, 3.0)]
    trimmed = ck.source("trimmed", of=ck.source("union", members=bowls), trim="z - 0.5")
    whole = ck.source(
        "union",
        members=[trimmed, ck.source("moved", of=ck.source("analytic.cap", height=0.5), translation=[3.0, 0, 9.0])],
    )
    queries = [[0, 0, 2.0], [3.0, 0, 2.0], [2.0, 0, -2.0], [0.5, 0, -2.0], [3.2, 0, 8.0]]
    edges = whole.closest_point(np.array(queries)).edge
    assert len(set(edges.tolist())) == 5
    assert (edges >= 0).all()


def test_an_edge_beyond_the_limit_is_refused():
    class Many(Able):
        edge_limit = 1000

        def closest_point(self, x, /):
            return replace(super().closest_point(x), edge=np.full(len(x), 1234))

    with pytest.raises(ck.InputError, match="edge with the number 1234, where the limit is 1000"):
        ck.source("union", members=[Many(np.zeros(2)), SECOND]).closest_point(QUERIES)


@pytest.mark.parametrize("how", ["as it is", "moved", "in a union", "trimmed"])
def test_a_cut_keeps_its_left_on_a_surface_without_normals(how):
    """Left is where the function is positive; moved or united it came back on the other side."""
    from bare import Bare

    sphere = Bare(ck.source("analytic.sphere"))
    cut = ck.source("cut.function", surface=sphere, phi="-(z + 0.1*x + 0.3)", resolution=24)
    wrapped = {
        "as it is": lambda: cut,
        "moved": lambda: ck.source("moved", of=cut),
        "in a union": lambda: ck.source("union", members=[cut]),
        "trimmed": lambda: ck.source("trimmed", of=cut, trim="x - 0.9"),
    }[how]()
    below, above = [0.0, -0.6, -0.8], [0.0, -1.0, 0.0]
    boundary = ck.Boundary("cut", wrapped, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    scene = ck.Scene(sphere, ck.Laplace(), [boundary])
    layout = ck.discretize(scene, 0.4, form="collocation").tables.layout
    view = layout.boundaries.on_lattice[0].side_view(layout.lattice.to_local(np.array([below, above])), np.inf, 0.4)
    assert (view.signed > 0).tolist() == [True, False]
    if how != "trimmed":
        assert ck.solve(scene, 0.4).evaluate([[0, 0, -1.0], [0, 0, 1.0]]) == pytest.approx([1.0, 0.0], abs=1e-6)
