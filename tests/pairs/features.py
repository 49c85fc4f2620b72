"""The features, each a change of a case; and the pairs of them that cannot meet, with the reason."""

from dataclasses import replace

from pairs.case import Part, with_part

#: Two sheets, in spacings.
APART = 1.5


def sheets(case):
    """Two circles, one inside the other, so near that they share nodes."""
    first = case.parts[0]
    return with_part(case, replace(first, radius=1 + APART * case.spacing, more=2.0))


def two_solids(case):
    second = Part(center=(3.0, 0.1), more=3.0, cut=False)
    return replace(with_part(case, second), solid=True, spacing=0.1)


def edges(case):
    """An arc, where the manifold is a curve; on all edges a Robin condition."""
    return replace(case, edge="robin", parts=tuple(replace(one, arc=(-2.6, 2.0)) for one in case.parts))


def open_tips(case):
    return replace(case, solid=True, tips=True, spacing=0.1)


def transmission(case):
    return replace(case, inside="transmission")


def order(number):
    degree = {"degree": 4} if number == 4 else {}
    return lambda case: replace(case, options={**case.options, "order": number, **degree})


def moved(case):
    return replace(case, moved=True)


def union(case):
    """A further part, far away, with another constant, and without a boundary."""
    return with_part(case, Part(center=(-3.1, 0.4), radius=0.8, more=-2.0, cut=False))


def trimmed(case):
    return replace(case, trimmed=True)


def no_normals(case):
    """No abilities but closest points; which side is left is told by a point."""
    return replace(case, bare=True)


def crowded(case):
    return replace(case, crowded=True)


def null_space(case):
    return replace(case, free=True)


def heat(case):
    return replace(case, heat=True)


def load(case):
    return replace(case, reloaded=True)


#: In the order in which they change a case.
FEATURES = {
    "open tips": open_tips,
    "edges": edges,
    "sheets": sheets,
    "two solids": two_solids,
    "union": union,
    "transmission": transmission,
    "several boundaries in one stencil": crowded,
    "order 1": order(1),
    "trimmed": trimmed,
    "no normals": no_normals,
    "moved": moved,
    "null space": null_space,
    "heat": heat,
    "load": load,
}

FLAT = "sheets lie above each other, and areas of the plane do not"
CANNOT_MEET = {
    frozenset(("sheets", "two solids")): FLAT,
    frozenset(("sheets", "open tips")): FLAT,
}
