"""Curves in solids in space, such as vessels in tissue: their radius decides what flows, whatever the spacing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import k0
from union_problems import BALL, VESSEL, in_ball, ring_in_ball

import cpmkit as ck
from cpmkit.errors import SceneError

RESISTANCE = 0.3


def potential_of_line(x, wavenumber):
    """The potential of cos(k z) on the z axis."""
    distance = np.hypot(x[:, 0], x[:, 1])
    if not wavenumber:
        return -np.log(distance) / (2 * np.pi)
    return np.cos(wavenumber * x[:, 2]) * k0(wavenumber * distance) / (2 * np.pi)


def line_in_box(radius, wavenumber, seed):
    """A segment from face to face of a moved box gives cos(k z) to it per length; v is its own value along it."""
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=rng), rng.uniform(-0.1, 0.1, 3)

    def inside(x):
        return turn.inv().apply(x - shift)

    def u(x):
        return potential_of_line(inside(x), wavenumber)

    def v(x):
        z = inside(x)[:, 2]
        return np.cos(wavenumber * z) * (potential_of_line(np.array([[radius, 0, 0]]), wavenumber)[0] + RESISTANCE)

    box = ck.source("analytic.box", lower=[-0.8, -0.7, 0], upper=[0.7, 0.8, 1])
    line = ck.source("analytic.segment", start=shift, end=turn.apply([0, 0, 1]) + shift)
    union = ck.source("union", members=[ck.source("moved", of=box, rotation=turn.as_matrix(), translation=shift), line])
    f = ck.MemberData(union, [0.0, lambda x: wavenumber**2 * v(x) + np.cos(wavenumber * inside(x)[:, 2])])
    edge = {side: ck.Dirichlet(u) for side in range(4)} | {4: ck.Neumann(0.0), 5: ck.Neumann(0.0)}
    junctions = ck.Junction(radius=radius, resistance=RESISTANCE)
    return ck.Scene(union, ck.Elliptic(f=f), edge=edge, junctions=junctions), v, line


@pytest.mark.parametrize("wavenumber", [0.0, np.pi])
@pytest.mark.parametrize("radius", [1e-4, 0.02, 0.15])
def test_the_value_along_a_line_is_that_of_its_radius_at_any_spacing_and_position(radius, wavenumber):
    for seed, spacing in enumerate((0.2, 0.14, 0.1)):
        scene, v, line = line_in_box(radius, wavenumber, seed)
        found = ck.solve(scene, spacing, estimate=False)
        assert found.discretized.form == "galerkin"
        assert found.report.iterations <= 30
        at = line.closest_point(np.random.default_rng(0).uniform(-1, 1, (50, 3))).points
        # what flows is 1 per length: an error of v is one of the resistance, in a disc of this size
        size = max(3 * spacing, 2 * radius)
        assert np.abs(found.of_dimension(1).evaluate(at) - v(at)).max() < 5e-4 + 0.012 * size**2


def test_around_a_ring_errors_fall_with_order_two():
    problem = ring_in_ball(0.02)
    scene, ring = problem.scene, problem.scene.surface.members[1]
    at = in_ball()
    at = at[ring.closest_point(at).distance > 0.3]
    points, on_ring, away = ring.closest_point(at[:100]).points, [], []
    for spacing in (0.14, 0.107, 0.08):
        found = ck.solve(scene, spacing, estimate=spacing == 0.14)
        on_ring.append(np.abs(found.of_dimension(1).evaluate(points) - problem.exact[1](points)).max())
        away.append(np.abs(found.of_dimension(3).evaluate(at) - problem.exact[3](at)).max())
        assert spacing != 0.14 or 0.5 * on_ring[-1] < found.error.error[0] < 5 * max(on_ring[-1], away[-1])
        # all that flows leaves through the skin
        assert found.flux(0) == pytest.approx(-np.pi, rel=1e-6)
    for errors in (on_ring, away):
        assert np.log(errors[0] / errors[-1]) / np.log(0.14 / 0.08) > 1.8
    assert on_ring[-1] < 2e-3


def test_a_network_of_vessels_with_radii_of_their_own():
    """Vessels that meet in a point have one value there; without a term c u the flows of all ends balance."""
    joint = np.array([0.05, -0.03, 0.02])
    ends = np.array([[-0.6, 0.1, 0.1], [0.4, 0.5, -0.1], [0.3, -0.5, 0.2]])
    vessels = [ck.source("analytic.segment", start=joint, end=end) for end in ends]
    union = ck.source("union", members=[BALL, *vessels])
    laws = {(0, 1): ck.Junction(radius=0.1), (0, 2): ck.Junction(radius=0.01), (0, 3): ck.Junction(radius=0.05)}
    problem = ck.Elliptic(diffusivity=ck.MemberData(union, [1.0, 4.0, 2.0, 2.0]))
    edge = {0: ck.Dirichlet(0.0), 1001: ck.Dirichlet(1.0), 2001: ck.Dirichlet(0.5), 3001: ck.Neumann(0.0)}
    found = ck.solve(ck.Scene(union, problem, edge=edge, junctions=laws), 0.15)
    near = joint + 1e-6 * (ends - joint)
    assert np.ptp(found.of_dimension(1).evaluate(near)) < 1e-4
    # fluxes are of du/db: times the diffusivity of a member they balance
    flows = [found.flux(loop) * a for loop, a in ((0, 1.0), (1001, 4.0), (2001, 2.0), (3001, 2.0))]
    assert flows[1] > 0.5
    assert flows[3] == 0
    assert sum(flows) == pytest.approx(0.0, abs=1e-6)
    # all ends insulated and c = 1 in the ball: f = 1 on the vessels is what c u takes away
    problem = ck.Elliptic(f=ck.MemberData(union, [0.0, 1, 1, 1]), c=ck.MemberData(union, [1.0, 0, 0, 0]))
    found = ck.solve(ck.Scene(union, problem, junctions=laws), 0.15, estimate=False)
    length = np.linalg.norm(ends - joint, axis=1).sum()
    assert found.integrate(dim=3) == pytest.approx(length, rel=1e-7)
    assert found.flux("edge") == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("junctions", "problem", "sentence"),
    [
        (ck.Junction(), ck.ScreenedPoisson(1.0), r"meet along the curve, .*logarithm.*give the radius r"),
        (ck.Junction(radius=0.5), ck.ScreenedPoisson(1.0), "at most a tenth of the largest side"),
        (ck.Junction(radius=0.05), ck.Elliptic(1.0, diffusivity=np.diag([1.0, 2, 3]), c=1.0), "got a tensor"),
    ],
)
def test_curves_without_a_small_radius_and_tensors_are_refused(junctions, problem, sentence):
    with pytest.raises(SceneError, match=sentence):
        ck.solve(ck.Scene(ck.source("union", members=[BALL, VESSEL]), problem, junctions=junctions), 0.3)


@pytest.mark.parametrize(("depth", "is_near"), [(0.05, True), (0.4, False)])
def test_a_curve_beside_the_skin_has_a_warning(depth, is_near):
    box = ck.source("analytic.box", lower=[-1, -1, -1], upper=[1, 1, 1])
    line = ck.source("analytic.segment", start=[-1, 0, 1 - depth], end=[1, 0, 1 - depth])
    union = ck.source("union", members=[box, line])
    scene = ck.Scene(union, ck.ScreenedPoisson(1.0), junctions=ck.Junction(radius=0.02))
    warnings = ck.solve(scene, 0.2, estimate=False).warnings
    assert any("within a spacing of the boundary" in text for text in warnings) == is_near
