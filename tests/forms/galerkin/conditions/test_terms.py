"""What conditions add and refuse: near pairs, tips, points, eigenvalues at rims, fluxes of u, tables of edges."""

from dataclasses import replace

import numpy as np
import pytest
from cylinder_problems import (
    AXIS,
    CUT,
    LENGTH,
    RADIUS,
    cylinder_mesh,
    local,
    placed,
    problem,
)
from model_problems import order_of
from scipy.sparse.linalg import splu
from small_galerkin import circle_mesh, small

import cpmkit as ck
from cpmkit.errors import InputError, SceneError
from cpmkit.forms.galerkin.conditions.imposed_conditions import point_warnings
from cpmkit.mesh.subdivision import split_at_knot_planes
from cpmkit.plugin import Mesh

SURFACE = ck.source("analytic.cylinder", axis=AXIS, radius=RADIUS, length=LENGTH)


def ring(height):
    return ck.source("analytic.circle", center=(height - 0.5 * LENGTH) * AXIS, normal=AXIS, radius=RADIUS)


def two_rings(spacing, gap):
    """The cylinder's mesh with a second cut a ``gap`` above the first: a ring of triangles is moved there."""
    mesh = cylinder_mesh(spacing)
    height, angle = local(mesh.vertices)
    rings = np.unique(height.round(9))
    old = rings[np.searchsorted(rings, CUT - 1e-9) + 1]
    moved = np.where(np.abs(height - old) < 1e-9, CUT + gap, height)
    places = np.stack([moved, angle], axis=-1)[mesh.cells]
    places[..., 1] = np.mod(places[..., 1] - places[:, :1, 1] + np.pi, 2 * np.pi) - np.pi + places[:, :1, 1]
    middles = 0.5 * (np.roll(places, -1, axis=1) + np.roll(places, -2, axis=1))
    around = len(mesh.cut)
    return replace(
        mesh,
        vertices=placed(moved, angle),
        midpoints=placed(middles[..., 0], middles[..., 1]),
        cut=np.concatenate([mesh.cut, mesh.cut + around]),
        owner=np.repeat([0, 1], around),
        beyond_tip=np.zeros(2 * around, dtype=bool),
    )


@pytest.mark.parametrize("gap", [0.1, 1e-2, 1e-6])
def test_near_pairs_stay_definite(gap):
    """Values on four sides, two of them a share of the spacing apart: locally the penalty is in that width's unit."""
    spacing = 0.2
    cuts = [
        ck.Boundary("lower", ring(CUT), left=ck.Dirichlet(2.0), right=ck.Dirichlet(1.0)),
        ck.Boundary("upper", ring(CUT + gap * spacing), left=ck.Dirichlet(3.0), right=ck.Dirichlet(2.0)),
    ]
    scene = ck.Scene(SURFACE, ck.Poisson(0.0), cuts)
    for place in np.random.default_rng(3).uniform(size=(4, 3)):
        one = small(scene, two_rings(2 * spacing, gap * spacing), spacing, spacing * place)
        assert one.definite()
        height, _ = local(one.points)
        wanted = np.select([height < CUT, height < CUT + gap * spacing], [1.0, 2.0], 3.0)
        assert np.abs(one.solved()[:, 0] - wanted).max() < 1e-6


def square_with_slit(count, tip, reach):
    """Triangles on the square from -1 to 1, cut along the axis from the left to ``tip``, on past it to ``reach``."""
    x = np.linspace(-1, 1, count + 1)
    number = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    cells = np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))])
    line = number[:, count // 2]
    middle = 0.5 * (x[1:] + x[:-1])
    on = middle < reach
    cut = np.stack([line[:-1], line[1:]], axis=1)[on]
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    vertices = np.concatenate([grid, np.zeros((len(grid), 1))], axis=1)
    return Mesh(vertices, cells, None, cut, np.zeros(len(cut), dtype=np.int64), middle[on] > tip)


def slit_error(spacing, reach):
    """The error of u = sqrt(r) sin(angle / 2) about the tip of a slit without flux, away from the tip."""
    surface = ck.source(
        "mesh.triangles",
        vertices=np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        closest="faceted",
    )

    def exact(x):
        return np.sqrt(np.hypot(x[:, 0], x[:, 1])) * np.sin(0.5 * np.arctan2(x[:, 1], x[:, 0]))

    line = ck.source("analytic.segment", start=[-1, 0, 0], end=[0, 0, 0])
    scene = ck.Scene(surface, ck.Laplace(), [ck.Boundary("slit", line, both=ck.Neumann())], edge=ck.Dirichlet(exact))
    turn = np.array([0.37, 0.21, 0.4]) * spacing
    count = 2 * int(np.ceil(2 / spacing))
    one = small(scene, square_with_slit(count, 0.0, reach), spacing, turn)
    off = np.abs(one.solved()[:, 0] - exact(one.points))
    return np.sqrt(np.mean(off**2)), one


def test_slits_are_continued_past_their_tips():
    """A support that holds the tip has one copy, so that a slit acts as if shorter; past it u goes on."""
    for spacing in (0.2, 0.1):
        without, (continued, one) = slit_error(spacing, 0.0)[0], slit_error(spacing, 3 * spacing)
        assert continued < without / 5
        assert one.definite()


def plain(scene, spacing=0.2, **points):
    mesh = cylinder_mesh(2 * spacing)
    if not scene.boundaries:
        mesh = replace(mesh, cut=mesh.cut[:0], owner=mesh.owner[:0], beyond_tip=mesh.beyond_tip[:0])
    return small(scene, mesh, spacing, spacing * np.array([0.1, 0.6, 0.3]), **points)


def pinned(law, *more, edge=None):
    mesh = cylinder_mesh(0.4)
    nowhere = replace(mesh, cut=mesh.cut[:0], owner=mesh.owner[:0], beyond_tip=mesh.beyond_tip[:0])
    pin = ck.Boundary("pin", ck.source("analytic.point", at=mesh.vertices[100]), both=law)
    scene = ck.Scene(SURFACE, ck.Laplace(), [pin], edge=edge or ck.Neumann())
    return scene, small(scene, nowhere, 0.2, points={0: np.array([100])})


def test_a_point_of_a_surface_fixes_the_constant():
    scene, one = pinned(ck.Dirichlet(3.0))
    assert np.abs(one.solved() - 3.0).max() < 1e-8
    assert point_warnings(scene, one.conditions.samples, 0.2) == ()
    imposed = pinned(ck.Dirichlet(3.0), edge=ck.Dirichlet(1.0))
    assert "'pin': a point of a surface, or" in point_warnings(imposed[0], imposed[1].conditions.samples, 0.2)[0]


def test_a_point_of_a_surface_takes_no_flux():
    with pytest.raises(SceneError, match="a neumann condition at a point of a surface has no effect"):
        pinned(ck.Neumann(1.0))


def test_eigenvalues_at_rims():
    """du/db = lambda u on both rims: 0, 2 / length, and m/r tanh(m length / 2 r) for cos(m angle)."""
    from scipy.linalg import eigh

    scene = ck.Scene(SURFACE, ck.Eigen(4), edge=ck.Steklov())
    found = []
    for spacing in (0.4, 0.2, 0.14):
        one = plain(scene, spacing)
        b, a = one.conditions.boundary_mass, one.matrix
        assert (b != b.T).nnz == 0
        largest = (a.shape[0] - 4, a.shape[0] - 1)
        shares = eigh(b.toarray(), (a + b).toarray(), eigvals_only=True, subset_by_index=largest)[::-1]
        found.append(np.abs(1 / shares - 1 - np.array([0, 2 * np.tanh(1.0), 2 * np.tanh(1.0), 2])))
    assert np.max(found, axis=1)[0] < 0.1
    assert order_of((0.4, 0.2, 0.14), np.max(found, axis=1)) > 2.5


def bar(law, spacing=0.05):
    start, end = np.array([0.1, 0.2]), np.array([0.7, 1.0])
    surface = ck.source("analytic.segment", start=start, end=end)
    scene = ck.Scene(surface, ck.Laplace(), edge={0: ck.Dirichlet(2.0), 1: law})
    x = start + np.linspace(0, 1, 41)[:, None] * (end - start)
    cells = np.stack([np.arange(40), np.arange(1, 41)], axis=1)
    return small(scene, split_at_knot_planes(Mesh.of(x, cells), spacing), spacing), start


def test_fluxes_that_depend_on_the_solution():
    """A bar held at 2 that radiates u^4 at its end, a length of 1 away: u = 2 - s, by Newton's method."""
    one, start = bar(ck.NonlinearFlux(lambda u: -(u**4)))
    flux = one.conditions.state_fluxes[0]
    seen, conditions = np.full(len(flux.points), flux.guess), one.conditions
    for _ in range(8):
        assert flux.grows(seen)
        one.conditions = conditions.linearise([seen])
        u = splu(one.matrix).solve(one.b + one.conditions.load(1))
        seen = flux.read(u)
    assert np.allclose(flux.points, [[0.7, 1.0]])
    assert seen == pytest.approx(1.0, abs=1e-6)
    assert np.allclose((one.rows @ u)[:, 0], 2 - np.linalg.norm(one.points - start, axis=1), atol=1e-6)
    assert one.conditions.state_fluxes == []


def test_a_flux_that_does_not_grow_is_a_flux():
    one, _ = bar(ck.NonlinearFlux(lambda u: -0.5 + 0 * u))
    flux = one.conditions.state_fluxes[0]
    assert not flux.grows(np.ones(1))
    one.conditions = one.conditions.linearise([np.ones(1)])
    assert one.solved()[:, 0].min() > 1.5 - 1e-6


@pytest.mark.parametrize(
    ("edge", "sentence"),
    [
        ({0: ck.Dirichlet(0.0)}, "has the loops 0, and the manifold's loops 1 are missing"),
        ({0: ck.Dirichlet(0.0), 1: ck.Neumann(), 2: ck.Neumann()}, "loop 2, and the manifold has no such loop"),
    ],
)
def test_tables_of_edges_fit_the_loops(edge, sentence):
    with pytest.raises(SceneError, match=sentence):
        plain(ck.Scene(SURFACE, ck.Laplace(), edge=edge))


def test_a_source_that_numbers_no_edge_is_told_so():
    class Unnumbered:
        dim, manifold_dim, exact, bounds = 3, 2, True, SURFACE.bounds

        def closest_point(self, x):
            return replace(SURFACE.closest_point(x), edge=np.full(len(x), -1))

    with pytest.raises(SceneError, match="no such loop: its source gives no edge a number"):
        ck.solve(ck.Scene(Unnumbered(), ck.Laplace(), edge={0: ck.Dirichlet(0.0)}), 0.5)


def test_an_edge_that_is_not_there_has_no_condition():
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1.0, 0.0]), both=ck.Dirichlet(2.0))
    scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [cut], edge=ck.Dirichlet(1.0))
    with pytest.raises(SceneError, match="is closed"):
        small(scene, circle_mesh(0.2, np.zeros(1)), 0.2)


def test_couplings_lie_between_two_sides():
    rim = ck.Boundary("rim", ring(0.0), across=ck.Transmission())
    mesh = cylinder_mesh(0.4)
    around = len(mesh.cut)
    mesh = replace(mesh, cut=mesh.cut - mesh.cut.min() + np.zeros((around, 1), dtype=np.int64))
    with pytest.raises(SceneError, match="boundary 'rim' couples two sides and lies on the manifold's rim"):
        small(ck.Scene(SURFACE, ck.Laplace(), [rim]), mesh, 0.2)


def test_conductivities_are_those_of_the_problem():
    wrong = ck.Boundary("cut", ring(CUT), across=ck.Transmission(left=3.0, right=1.0))
    with pytest.raises(SceneError, match=r"gives the conductivity 3 on its left near .* diffusivity is 10;"):
        plain(ck.Scene(SURFACE, problem(10.0), [wrong]))


def test_robin_with_nothing_of_u_is_refused():
    nothing = ck.Boundary("cut", ring(CUT), both=ck.Robin(1.0, lambda x: 0 * x[:, 0]))
    with pytest.raises(InputError, match="beta of Robin of boundary 'cut' is zero"):
        plain(ck.Scene(SURFACE, ck.Laplace(), [nothing]))


def test_materials_are_distinguished_beside_a_boundary_that_is_off():
    """The diffusivity jumps a tenth of the spacing beside the curve: each side still has its own."""
    spacing = 0.2

    def a(x):
        return np.where(local(x)[0] < CUT + 0.1 * spacing, 1.0, 100.0)

    cut = ck.Boundary("cut", ring(CUT), across=ck.Transmission())
    one = plain(ck.Scene(SURFACE, ck.Elliptic(0.0, diffusivity=a, c=1.0), [cut]), spacing)
    assert np.allclose(one.conditions.a, np.where(one.left, 100.0, 1.0))


def test_data_have_channels_and_times():
    ramp = ck.Dirichlet([1.0, lambda x, t: t + 0 * x[:, 0]])
    cut = ck.Boundary("cut", ring(CUT), left=ramp, right=ck.Neumann([0.0, lambda x, t: 2 * t]))
    heat = ck.Heat(initial=[0.0, 0.0], until=1.0, step=0.1)
    one = plain(ck.Scene(SURFACE, heat, [cut]))
    early, late = (one.conditions.load(2, time) for time in (1.0, 3.0))
    assert early.shape == (len(one.b), 2)
    assert np.allclose(early[:, 0], late[:, 0])
    assert np.allclose(3 * early[:, 1], late[:, 1])
    assert np.abs(early[:, 1]).max() > 0


def test_a_ring_just_above_a_knot_plane_keeps_every_eigenvalue_above_zero():
    """With samples clipped at knot planes, a sixth of the spacing above one: the least was -1e-4 at a penalty of 40."""
    ring_there = ck.source("analytic.circle", center=[0, 0, -0.5], radius=np.sqrt(0.75), normal=[0, 0, 1])
    imposed = ck.Scene(
        ck.source("analytic.sphere"), ck.Laplace(), [ck.Boundary("ring", ring_there, both=ck.Dirichlet(3))]
    )
    solution = ck.solve(imposed, 0.15, form="galerkin", solver="multigrid")  # its cycle refuses such eigenvalues
    np.testing.assert_allclose(solution.evaluate([[0, 0, 1.0], [0, 0, -1.0]]), 3.0, atol=1e-7)


def test_a_boundary_on_the_whole_rim_replaces_the_condition_of_the_edge():
    rim = ck.Boundary("rim", ck.source("analytic.circle", normal=[0, 0, 1]), both=ck.Dirichlet(1.0))
    cap = ck.source("analytic.cap")
    for edge in (ck.Dirichlet(1.0), ck.Dirichlet(5.0)):
        solution = ck.solve(ck.Scene(cap, ck.Laplace(), [rim], edge=edge), 0.3, form="galerkin")
        np.testing.assert_allclose(solution.evaluate([[0, 0, 1], [0.6, 0, 0.8]]), 1.0, atol=1e-6)
