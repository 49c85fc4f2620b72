"""From a case to its scene: sources, conditions that its exact solution fulfils, the problem."""

import numpy as np
from bare import Bare

import cpmkit as ck
from pairs.case import BESIDE, CUT, RESISTANCE, RING_CENTER, RING_RADIUS, ROTATION, SHIFT, TIPS, TRIM


def scene_of(case):
    return ck.Scene(surface_of(case), problem_of(case), boundaries_of(case), **edge_of(case))


def surface_of(case):
    members = [_member(case, part) for part in case.parts]
    whole = members[0] if len(members) == 1 else ck.source("union", members=members)
    return _moved(case, Bare(whole) if case.bare else whole)


def _member(case, part):
    keys = {"center": part.center, "radius": part.radius}
    if case.solid:
        made = ck.source("solid", of=ck.source("analytic.circle", **keys))
    elif part.arc:
        made = ck.source("analytic.arc", **keys, start=part.arc[0], end=part.arc[1])
    else:
        made = ck.source("analytic.circle", **keys)
    return ck.source("trimmed", of=made, trim=f"{TRIM + part.center[0]} - x") if case.trimmed else made


def _moved(case, source):
    return ck.source("moved", of=source, rotation=ROTATION, translation=SHIFT) if case.moved else source


def problem_of(case):
    def f(x):
        return case.minus_laplacian(x) + case.c * case.u(x)

    if case.heat:
        grown = datum(case, lambda x: case.u(x) + f(x), lambda x: f(x))
        return ck.Heat(lambda x: case.u(case.to_local(x)), until=0.1, step=0.05, f=grown, c=case.c)
    return ck.Elliptic(datum(case, f), c=case.c)


def datum(case, value, growth=None):
    """Data at points of the world; in time they are ``value + t growth``, the growth the value unless given."""
    if case.heat:
        return lambda x, t: value(case.to_local(x)) + t * (growth or value)(case.to_local(x))
    return lambda x: value(case.to_local(x))


def edge_of(case):
    if not (case.solid or case.trimmed or any(one.arc for one in case.parts)):
        return {}

    def flux(x):
        return case.slope(x, case.outward(x))

    if case.free:
        return {"edge": ck.Neumann(datum(case, flux))}
    if case.edge == "robin":
        return {"edge": ck.Robin(1.0, 2.0, datum(case, lambda x: flux(x) + 2 * case.u(x)))}
    return {"edge": ck.Dirichlet(datum(case, case.u))}


def boundaries_of(case):
    found = []
    if case.inside != "nothing":
        found += _ring(case) if case.solid else _cuts(case)
    if case.tips:
        open_curve = ck.source("analytic.segment", start=TIPS[0], end=TIPS[1])
        along = np.subtract(TIPS[1], TIPS[0]) / np.linalg.norm(np.subtract(TIPS[1], TIPS[0]))
        found.append(_through(case, "open", open_curve, np.array([-along[1], along[0]])))
    return found


def _ring(case):
    """The ring runs counter-clockwise, and left is inside."""

    def left(x):
        return (RING_CENTER - x) / np.maximum(np.linalg.norm(RING_CENTER - x, axis=1, keepdims=True), 1e-9)

    def circle(radius):
        return ck.source("analytic.circle", center=RING_CENTER, radius=radius)

    found = [_boundary(case, "ring", circle(RING_RADIUS), left, RING_CENTER)]
    if case.crowded:
        second = circle(RING_RADIUS + BESIDE * case.spacing)
        found.append(_boundary(case, "second ring", second, left, RING_CENTER, "values"))
    return found


def _cuts(case):
    """Points on circles; left is where the curve comes from, which a bare one has to be told."""
    found = []
    for number, part in enumerate(case.parts):
        for sign in (1, -1) if part.cut else ():
            p = np.array([CUT, sign * np.sqrt(part.radius**2 - CUT**2)])
            angle = np.arctan2(p[1], p[0])

            def at(angle, part=part):
                return np.array(part.center) + part.radius * np.array([np.cos(angle), np.sin(angle)])

            def left(x):
                return -case.tangent(x)

            name = f"cut {number} {sign}"
            source = ck.source("analytic.point", at=at(angle))
            found.append(_boundary(case, name, source, left, at(angle - 0.1)))
            if case.crowded:
                further = angle + BESIDE * case.spacing / part.radius
                beside = ck.source("analytic.point", at=at(further))
                found.append(_boundary(case, f"beside {name}", beside, left, at(further - 0.1), "values"))
    return found


def _through(case, name, source, left):
    """A boundary across which u is smooth: values on both sides, or fluxes where a constant is free."""
    if not case.free:
        return ck.Boundary(name, _moved(case, source), both=ck.Dirichlet(datum(case, case.u)))
    sides = {
        side: ck.Neumann(datum(case, lambda x, sign=sign: sign * case.slope(x, np.tile(left, (len(x), 1)))))
        for side, sign in (("left", -1), ("right", 1))
    }
    return ck.Boundary(name, _moved(case, source), **sides)


def _boundary(case, name, source, left, left_of, holds=None):
    def near(sign):
        return lambda x: case.u(x + sign * 1e-4 * left(x)) - sign * 1e-4 * case.slope(x, left(x))

    def slope(x):
        return case.slope(x, left(x))

    hint = {"left_of": case.to_world(np.atleast_2d(left_of))[0]} if case.bare else {}
    moved = _moved(case, source)
    holds = holds or case.inside
    if holds == "transmission":
        jump = datum(case, lambda x: near(1)(x) - near(-1)(x) - RESISTANCE * slope(x))
        return ck.Boundary(name, moved, across=ck.Transmission(jump, resistance=RESISTANCE), **hint)
    right = ck.Neumann(datum(case, slope))
    if holds == "values" and not case.free:
        right = ck.Dirichlet(datum(case, near(-1)))
    if case.free:
        return ck.Boundary(name, moved, left=ck.Neumann(datum(case, lambda x: -slope(x))), right=right, **hint)
    return ck.Boundary(name, moved, left=ck.Dirichlet(datum(case, near(1))), right=right, **hint)
