"""Rims that face each other across a gap: a narrow one is refused, a wider one told with what may leak."""

import numpy as np
import pytest

import cpmkit as ck

ENDS = {0: ck.Dirichlet(0.0), 1: ck.Dirichlet(1.0)}


def open_circle(gap, spacing=0.1):
    arc = ck.source("analytic.arc", radius=1.0, start=gap / 2, end=2 * np.pi - gap / 2)
    return ck.solve(ck.Scene(arc, ck.Laplace(), edge=ENDS), spacing, form="collocation")


def gaps(warnings):
    return [text for text in warnings if "faces itself across a gap" in text]


@pytest.mark.parametrize("gap", [0.04, 0.08, 0.15])
def test_a_gap_that_is_bridged_is_refused(gap):
    cure = f"{gap / 6:.2g}"
    with pytest.raises(ck.ResolutionError, match=rf"too coarse for the gap of {gap:.3g}.*near \(1.*use {cure}"):
        open_circle(gap)


@pytest.mark.parametrize(("gap", "leak"), [(0.2, "45%"), (0.3, "23%"), (0.49, "6%")])
def test_a_wider_gap_is_reported_with_a_bound_of_the_leak(gap, leak):
    solution = open_circle(gap)
    (message,) = gaps(solution.warnings)
    assert f"up to {leak} of the difference" in message
    length = 2 * np.pi - gap
    exact = (np.array([0.5, 1.0, 1.5]) * np.pi - gap / 2) / length
    assert np.abs(solution.evaluate([[0, 1], [-1, 0], [0, -1]]) - exact).max() < float(leak[:-1]) / 100


def test_the_spacing_that_is_named_does():
    assert not gaps(open_circle(0.3, 0.04999).warnings)
    assert not gaps(open_circle(0.7).warnings)


def test_explain_reports_it_too():
    arc = ck.source("analytic.arc", radius=1.0, start=0.1, end=2 * np.pi - 0.1)
    scene = ck.Scene(arc, ck.Laplace(), edge=ENDS)
    assert gaps(ck.explain(scene, 0.1, form="collocation", dry_run=True).warnings)
    assert "faces itself across a gap" in str(ck.explain(scene, 0.1, form="collocation", dry_run=True))


def slit_sphere(gap):
    return ck.source("trimmed", of=ck.source("analytic.sphere"), trim=f"{gap} - 2*abs(z)")


def test_a_slit_in_a_surface():
    with pytest.raises(ck.ResolutionError, match=r"too coarse for the gap of 0.2 between rims"):
        ck.solve(ck.Scene(slit_sphere(0.2), ck.ScreenedPoisson(1.0)), 0.2, form="collocation")
    solution = ck.solve(ck.Scene(slit_sphere(0.5), ck.ScreenedPoisson(1.0)), 0.2, form="collocation")
    assert "a gap of 0.5, 2.5 spacings" in gaps(solution.warnings)[0]


@pytest.mark.parametrize("kind", ["segments", "solids"])
def test_two_pieces_of_a_union(kind):
    def piece(start):
        if kind == "segments":
            return ck.source("analytic.segment", start=[start, 0], end=[start + 1, 0])
        return ck.source("analytic.box", lower=[start, 0], upper=[start + 1, 1])

    for gap, told in ((0.2, 1), (0.7, 0)):
        scene = ck.Scene(ck.source("union", members=[piece(0.0), piece(1.0 + gap)]), ck.ScreenedPoisson(1.0))
        assert len(gaps(ck.solve(scene, 0.1, form="collocation").warnings)) == told


def test_pieces_that_touch_corners_and_small_openings_face_nothing():
    def segment(start, end):
        return ck.source("analytic.segment", start=start, end=end)

    curved = ck.source("union", members=[segment([0, 0], [1, 0]), segment([1, 0], [1, 1])])
    straight = ck.source("union", members=[segment([0, 0], [1, 0]), segment([1, 0], [2, 0])])
    box, tube = ck.source("analytic.box", lower=[0, 0], upper=[1, 1]), ck.source("analytic.cylinder", radius=0.3)
    for surface in (curved, straight, box, tube):
        assert not gaps(
            ck.explain(ck.Scene(surface, ck.ScreenedPoisson(1.0)), 0.15, form="collocation", dry_run=True).warnings
        )


def test_a_small_hole_is_reported_and_not_refused():
    cap = ck.source("analytic.cap", height=-0.995)  # its hole is one spacing wide
    solution = ck.solve(ck.Scene(cap, ck.ScreenedPoisson(1.0)), 0.2, form="collocation")
    assert "as good as closed" in gaps(solution.warnings)[0]
