"""Singular functions at the ends of curves in plane solids: cracks in discs, with known solutions."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import SceneError

DISC = ck.source("solid", of=ck.source("analytic.circle"))
SPACINGS, SHIFT = (0.2, 0.1, 0.05), np.array([0.37, 0.61])
#: The angle of the crack, and its end.
ANGLE, TIP = 0.4, np.array([0.03, -0.05])
HEADING = np.array([np.cos(ANGLE), np.sin(ANGLE)])
POINTS = np.random.default_rng(0).uniform(-0.7, 0.7, (3000, 2))


def straight(x):
    """Complex coordinates with the end of a straight crack at 0 and the crack on the negative axis."""
    apart = (x - TIP) @ np.stack([HEADING, [-HEADING[1], HEADING[0]]], axis=1)
    return apart[:, 0] + 1j * apart[:, 1]


def bent(x):
    """The same of a crack along a parabola, by a conformal map: z = w + i w^2 / 5."""
    return (-1 + np.sqrt(1 + 0.8j * straight(x))) / 0.4j


def crack(bend):
    normal = -HEADING[1], HEADING[0]
    t = [f"{TIP[k]:.17g} - t * ({HEADING[k]:.17g}) + {bend} * t**2 * ({normal[k]:.17g})" for k in range(2)]
    return ck.source("parametric.curve", x=t, range=[0, 1.2])


CRACKS = {"straight": (straight, crack(0)), "bent": (bent, crack(0.2))}
#: By the conditions on the left and the right: u of the complex coordinate.
SOLUTIONS = {
    ("flux", "flux"): lambda w: np.sqrt(w).imag,
    ("value", "value"): lambda w: np.sqrt(w).real,
    ("value", "flux"): lambda w: np.abs(w) ** 0.25 * np.sin((np.pi - np.angle(w)) / 4),
}
CONDITIONS = {"flux": ck.Neumann(0.0), "value": ck.Dirichlet(0.0)}


def solved(problem, kind, given, spacing, edge, tips="singular"):
    sides = dict(zip(("left", "right"), (CONDITIONS[each] for each in given), strict=True))
    boundary = ck.Boundary("crack", CRACKS[kind][1], **sides)
    scene = ck.Scene(DISC, problem, [boundary], edge=edge)
    return ck.solve(scene, spacing, origin=(SHIFT * spacing).tolist(), tips=tips)


def rms(values):
    return np.sqrt(np.mean(values**2))


@pytest.mark.parametrize("kind", CRACKS)
@pytest.mark.parametrize("given", SOLUTIONS)
def test_cracks_are_of_order_three(kind, given):
    coordinate, curve = CRACKS[kind]
    points = POINTS[curve.closest_point(POINTS).distance > 0.01]  # off the sides of a bent crack

    def u(x):
        return SOLUTIONS[given](coordinate(x))

    # the curve runs from its end to the skin: its left is at the right hand of one who walks to the end
    turned = given[::-1]
    errors, estimates = [], []
    for spacing in SPACINGS:
        solution = solved(ck.Poisson(0.0), kind, turned, spacing, ck.Dirichlet(u))
        errors.append(rms(solution.evaluate(points) - u(points)))
        estimates.append(float(np.ravel(solution.error.rms)[0]))
    assert errors[-1] < 4e-5
    assert np.log2(errors[0] / errors[-1]) / 2 > 2.6
    ratios = np.array(estimates) / errors
    assert ((ratios > 0.4) & (ratios < 3)).all()
    extended = solved(ck.Poisson(0.0), kind, turned, SPACINGS[-1], ck.Dirichlet(u), tips="extended")
    assert rms(extended.evaluate(points) - u(points)) > 30 * errors[-1]


def test_data_coefficients_and_a_source_keep_the_order():
    def root_slope(x):
        """The derivative of Im sqrt(w) along the axes."""
        by_w = 0.5 / np.sqrt(straight(x))
        return np.stack([by_w.imag, by_w.real], axis=1) @ np.stack([HEADING, [-HEADING[1], HEADING[0]]])

    def u(x):
        return np.sqrt(straight(x)).imag + 0.2 * np.cos(2 * ((x - TIP) @ HEADING))

    def f(x):
        """-div(a grad u) + 2 u for a = 1 + x / 2."""
        along = 2 * ((x - TIP) @ HEADING)
        smooth = -0.4 * np.sin(along) * HEADING[0]
        a = 1 + 0.5 * x[:, 0]
        return 0.8 * a * np.cos(along) - 0.5 * (root_slope(x)[:, 0] + smooth) + 2 * u(x)

    errors = []
    for spacing in SPACINGS:
        problem = ck.Elliptic(f=f, c=2.0, diffusivity=lambda x: 1 + 0.5 * x[:, 0])
        solution = solved(problem, "straight", ("flux", "flux"), spacing, ck.Dirichlet(u))
        errors.append(rms(solution.evaluate(POINTS) - u(POINTS)))
    assert errors[-1] < 4e-5
    assert np.log2(errors[0] / errors[-1]) / 2 > 2.6


def test_both_ends_of_a_crack_inside():
    def u(x):
        z = x[:, 0] + 1j * x[:, 1]
        return (np.sqrt(z - 0.4) * np.sqrt(z + 0.4)).imag

    middle = ck.source("analytic.segment", start=[-0.4, 0], end=[0.4, 0])
    boundary = ck.Boundary("crack", middle, both=ck.Neumann(0.0))
    scene = ck.Scene(DISC, ck.Poisson(0.0), [boundary], edge=ck.Dirichlet(u))
    errors = [
        rms(ck.solve(scene, h, origin=(SHIFT * h).tolist(), tips="singular").evaluate(POINTS) - u(POINTS))
        for h in SPACINGS
    ]
    assert errors[-1] < 1e-4
    assert np.log2(errors[0] / errors[-1]) / 2 > 2.6


def test_eigenvalues_of_a_disc_with_a_slit():
    """Functions J_(1/2)(k r) sin(t / 2) vanish on the circle for k = pi."""
    slit = ck.source("analytic.segment", start=[-1, 0], end=[0, 0])
    boundary = ck.Boundary("slit", slit, both=ck.Neumann(0.0))
    errors = []
    for h in SPACINGS:
        scene = ck.Scene(DISC, ck.Eigen(count=2), [boundary], edge=ck.Dirichlet(0.0))
        found = ck.solve(scene, h, origin=(SHIFT * h).tolist(), tips="singular").eigenvalues
        errors.append(found[1] / np.pi**2 - 1)
    assert 0 < errors[-1] < 1e-5
    assert np.log2(errors[0] / errors[-1]) / 2 > 3


def test_the_total_heat_stays_and_a_saved_solution_is_the_same(tmp_path):
    heat = ck.Heat(initial=lambda x: 1 + x[:, 1], until=0.1, step=0.01, frames=2)
    solution = solved(heat, "straight", ("flux", "flux"), 0.1, ck.Neumann(0.0))
    assert solution.integrate() == pytest.approx(solution.frames[0].integrate(), rel=1e-11)
    solution.save(tmp_path / "crack.npz")
    loaded = ck.load(tmp_path / "crack.npz", scene=solution.scene)
    np.testing.assert_allclose(loaded.evaluate(POINTS[:50]), solution.evaluate(POINTS[:50]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", CRACKS)
def test_fans_have_the_area_of_their_patches(kind):
    solution = solved(ck.Poisson(0.0), kind, ("flux", "value"), 0.1, ck.Dirichlet(0.0))
    form = solution.discretized
    sampled, interior = form.sampled, form.sampled.interior
    samples = sampled.samples
    areas = np.bincount(samples.cell[:interior], samples.weights[:interior])
    near = sampled.near_tips
    found = np.bincount(near.patch, near.weights, len(areas))
    np.testing.assert_allclose(found[near.replaced], areas[near.replaced], rtol=2e-5, atol=1e-4 * form.spacing**2)
    # a linear fit is exact for linear functions, also off the patch
    linear = samples.points[:interior] @ [1.0, -2.0] + 3
    np.testing.assert_allclose(near.from_samples @ linear, near.points @ [1.0, -2.0] + 3, atol=1e-12)


def test_solids_in_space_have_no_singular_functions():
    ball = ck.source("solid", of=ck.source("analytic.sphere"))
    with pytest.raises(SceneError, match="solids in space"):
        ck.discretize(ck.Scene(ball, ck.ScreenedPoisson(1.0)), 0.3, form="galerkin", tips="singular")


def fracture(resistance, half=0.4):
    """A conducting segment in a disc, u = Re sqrt(z^2 - a^2) in the disc without resistance."""

    def u(x):
        z = x[:, 0] + 1j * x[:, 1]
        return (np.sqrt(z - half) * np.sqrt(z + half)).real

    both = ck.source("union", members=[DISC, ck.source("analytic.segment", start=[-half, 0], end=[half, 0])])
    problem = ck.Elliptic(diffusivity=ck.MemberData(both, [1.0, 1e7]))
    edge = {0: ck.Dirichlet(u)}
    return ck.Scene(both, problem, edge=edge, junctions=ck.Junction(resistance=resistance)), u


def test_fractures_that_end_inside_are_of_order_three():
    scene, u = fracture(0.0)
    errors = [
        rms(
            ck.solve(scene, h, origin=(SHIFT * h).tolist(), tips="singular", estimate=False).evaluate(POINTS)
            - u(POINTS)
        )
        for h in SPACINGS
    ]
    assert errors[-1] < 1e-4
    assert np.log2(errors[0] / errors[-1]) / 2 > 2.6


def test_values_beside_fractures_with_a_resistance_settle_sooner():
    """There u behaves as beside a flux, and jumps."""
    scene = fracture(1.0)[0]
    scene = ck.Scene(scene.surface, scene.problem, edge={0: ck.Dirichlet("y")}, junctions=scene.junctions)

    def values(tips, spacing):
        return ck.solve(scene, spacing, tips=tips, estimate=False).evaluate(POINTS)

    settled = values("singular", 0.025)
    singular, extended = ([rms(values(tips, h) - settled) for h in SPACINGS] for tips in ("singular", "extended"))
    assert singular[-1] < extended[-1] / 20
    assert np.log2(singular[0] / singular[-1]) / 2 > 2


def test_a_tip_very_near_a_knot_plane():
    """Rounding decides where the lattice's knot planes cut the short segments beside the tip."""
    slit = ck.source("analytic.segment", start=[-1, 0], end=[0, 0])
    scene = ck.Scene(DISC, ck.Poisson(1.0), [ck.Boundary("slit", slit, both=ck.Neumann(0.0))], edge=ck.Dirichlet(0.0))
    values = [
        ck.solve(scene, 0.1, origin=[0.05 + off, 0.05], tips="singular", estimate=False).evaluate(POINTS)
        for off in (0.0, 1e-10, 1e-8)
    ]
    np.testing.assert_allclose(values[1:], [values[0]] * 2, atol=1e-5)
