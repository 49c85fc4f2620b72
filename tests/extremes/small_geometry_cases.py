"""The cases of benchmarks/below_the_spacing.py: scenes with geometry below the spacing, by groups."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from extremes.envelope_scenes import u_turn_line
from extremes.small_bodies import (
    BRACKET,
    CONE,
    CYLINDER,
    GEAR,
    bored_prism,
    cube,
    lens,
    real_mesh,
    smooth_control,
    turned_body,
)
from extremes.small_geometry import (
    SmallScene,
    bent_sheet,
    comb,
    ell,
    meeting_sheets,
    neck,
    plane_arms,
    plane_line,
    plate,
    plate_line,
    polyline_of,
    slot,
    square_hole,
)

SPACING = 0.05
CURVE_SPACINGS = (0.1, 0.05, 0.025)
TOLERANCES, PLATE_TOLERANCES = (1e-2, 1e-3, 1e-4), (3e-2, 1e-2, 3e-3)


@dataclass(frozen=True)
class Case:
    """A scene and how it is solved.

    Parameters
    ----------
    name, group : str
    make : callable
        Returns the scene.
    spacing : float
        Of the table of all cases.
    spacings : tuple of float
        Those among which the order is observed, or without cuts the error at equal unknowns; one if neither is.
    tolerances : tuple of float
        Those to which it is solved without a spacing.
    shared_truth : str
        The name of its true solution where cases share one.
    """

    name: str
    group: str
    make: Callable[[], SmallScene]
    spacing: float = SPACING
    spacings: tuple[float, ...] = ()
    tolerances: tuple[float, ...] = ()
    shared_truth: str = ""

    @property
    def truth_name(self) -> str:
        """The name of its true solution, which cases may share."""
        return self.shared_truth or self.name


def _fold(degrees: float) -> SmallScene:
    return bent_sheet(polyline_of([180, degrees], 0.9))


def _zigzag(degrees: float) -> SmallScene:
    turn = 90 - degrees / 2
    return bent_sheet(polyline_of([turn, -turn, turn, -turn, turn], 0.4))


def _sheets() -> list[Case]:
    cases = [
        Case(f"fold of {degrees} degrees", "sheets", partial(_fold, degrees), tolerances=tolerances)
        for degrees, tolerances in ((2, ()), (5, TOLERANCES), (20, TOLERANCES), (45, ()), (90, TOLERANCES), (120, ()))
    ]
    cases += [
        Case(
            f"plate {size:g} h thick",
            "sheets",
            lambda size=size: bent_sheet(plate_line(size * SPACING)),
            tolerances=TOLERANCES if size in (0.4, 2) else (),
        )
        for size in (0.1, 0.4, 1, 2)
    ]
    cases += [
        Case(name, "sheets", partial(meeting_sheets, degrees), tolerances=tolerances)
        for name, degrees, tolerances in (
            ("T of sheets", (0, 90, 180), TOLERANCES),
            ("Y of sheets", (0, 120, 240), ()),
            ("sheets at 0 20 180", (0, 20, 180), TOLERANCES),
            ("sheets at 0 5 10", (0, 5, 10), TOLERANCES),
            ("X of sheets", (0, 90, 180, 270), TOLERANCES),
            ("four sheets at 0 30 130 200", (0, 30, 130, 200), ()),
            ("five sheets", (0, 72, 144, 216, 288), ()),
        )
    ]
    return cases + [
        Case(f"zigzag of {degrees} degrees", "sheets", partial(_zigzag, degrees), tolerances=tolerances)
        for degrees, tolerances in ((20, ()), (60, TOLERANCES))
    ]


def _u_turns() -> list[Case]:
    cases = []
    for name, make in (("U-turn", bent_sheet), ("U-turn of a curve", plane_line)):
        cases += [
            Case(
                f"{name}, radius {size:g} h",
                "u-turns",
                lambda size=size, make=make: make(u_turn_line(size * SPACING)),
                tolerances=TOLERANCES if size in (0.25, 1) and make is bent_sheet else (),
            )
            for size in (0.1, 0.25, 0.5, 1)
        ]
    return cases


def _solids() -> list[Case]:
    cases = []
    for name, make, tolerances in (
        ("cube", cube, TOLERANCES),
        ("lens of two caps", partial(lens, level_set=False), TOLERANCES),
        ("lens as a level set", partial(lens, level_set=True), ()),
        ("cylinder with caps", partial(turned_body, CYLINDER), TOLERANCES),
        ("cone", partial(turned_body, CONE), ()),
    ):
        for spacing in (0.1, 0.05):
            kept = tolerances if spacing == SPACING else ()
            cases.append(
                Case(
                    f"{name}, h = {spacing:g}",
                    "solids",
                    make,
                    spacing,
                    tolerances=kept,
                    shared_truth=name.split(" ")[0],
                )
            )
    return cases


def _curves() -> list[Case]:
    return [
        Case(name, "curves", make, spacings=CURVE_SPACINGS, tolerances=tolerances)
        for name, make, tolerances in (
            ("corner of 90 degrees", lambda: plane_line(polyline_of([0, 90], 0.9)), ()),
            ("corner of 20 degrees", lambda: plane_line(polyline_of([0, 160], 0.9)), TOLERANCES),
            ("T of planar curves", lambda: plane_arms((0, 90, 180)), TOLERANCES),
        )
    ]


def _plates() -> list[Case]:
    cases = []
    for name, shape, sizes, tolerant in (
        ("slot {:g} h wide", slot, (0.2, 0.5, 1, 2), (0.5, 2)),
        ("neck {:g} h wide", neck, (0.1, 0.5, 1, 2), (1, 2)),
        ("comb of five slots of {:g} h", comb, (0.2, 1), (1,)),
        ("square hole of {:g} h", square_hole, (1, 2), ()),
    ):
        cases += [
            Case(
                name.format(size),
                "plates",
                lambda size=size, shape=shape: plate(shape(size * SPACING)),
                tolerances=PLATE_TOLERANCES if size in tolerant else (),
            )
            for size in sizes
        ]
    return [*cases, Case("L", "plates", lambda: plate(ell()))]


#: Two spacings of each mesh, for 3,000 to 5,000 and for about 6,000 unknowns, and a smaller one for errors at equal
#: unknowns.
MESH_SPACINGS = {
    "spot": (0.104, 0.073, 0.052),
    "fish": (0.085, 0.06, 0.042),
    "koala": (0.091, 0.064, 0.045),
    "nefertiti-lowres": (0.094, 0.066, 0.047),
    "bracket": (0.13, 0.095, 0.065),
    "gear": (0.16, 0.13, 0.07),
}
#: Those of mechanical parts.
PARTS = {"bracket": partial(bored_prism, BRACKET, 0.15, 0.6), "gear": partial(bored_prism, GEAR, 0.3, 0.3)}
#: The spacing of the true solutions on the others.
TRUTH_SPACING = 0.0125


def _meshes() -> list[Case]:
    return [
        Case(f"{name}, h = {spacing:g}", "meshes", make, spacing, spacings, (), name)
        for name, spacings in MESH_SPACINGS.items()
        for make in [PARTS.get(name) or partial(real_mesh, name, TRUTH_SPACING)]
        for spacing in spacings[:2]
    ]


def _icosphere(spacing: float) -> SmallScene:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4)
    return smooth_control("mesh.triangles", spacing, vertices=ball.vertices, faces=ball.faces)


def _ellipsoid(spacing: float) -> SmallScene:
    return smooth_control(
        "levelset.expression", spacing, phi="x**2 + y**2/.64 + z**2/.25 - 1", bounds=[[-1.2] * 3, [1.2] * 3]
    )


def _controls() -> list[Case]:
    return [
        Case(f"{name}, h = {spacing:g}", "controls", make, spacing, shared_truth=name)
        for name, make in (
            ("sphere", partial(smooth_control, "analytic.sphere", 0.025)),
            ("icosphere", partial(_icosphere, 0.025)),
            ("torus", partial(smooth_control, "analytic.torus", 0.025, major=1.0, minor=0.4)),
            ("ellipsoid", partial(_ellipsoid, 0.025)),
        )
        for spacing in (0.2, 0.1)
    ]


CASES = (*_sheets(), *_u_turns(), *_solids(), *_curves(), *_plates(), *_meshes(), *_controls())
