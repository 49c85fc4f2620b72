"""Junctions: how u and its flux behave where members of different dimension in a union meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from cpmkit.errors import SceneError, place, shown
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.meetings import Meeting, crossings, is_near, meetings_of
from cpmkit.manifold.source import MANIFOLD_WORDS, ClosestPointSource
from cpmkit.runtime.arrays import not_negative, positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.laws import Flux
from cpmkit.scene.special_conditions import Transmission

if TYPE_CHECKING:
    from cpmkit.scene.scene import Scene


@dataclass(frozen=True)
class Junction:
    """The law where members of different dimension in a union meet, in the Galerkin form.

    With v the solution on the member of lower dimension and u that on the other, ``u - v = resistance q``. Here q is
    what flows from u to v: along a curve in a surface or solid, or a surface on the boundary of a solid, per unit of
    length or area; where a curve meets a surface at a point, in all.

    A curve inside a surface or an area, or a surface inside a solid, has two sides, each with the whole resistance:
    ``u_left - v = resistance q_left`` and ``u_right - v = resistance q_right``. What enters v is their sum, and u may
    jump: ``solution.evaluate(points, side="both")`` reads its two values beside a curve.

    Parameters
    ----------
    resistance : float
        Zero, the default, for a continuous solution; an exchange with the rate k has the resistance 1 / k, and a vessel
        of radius r whose wall has the permeability k has 1 / (2 pi r k).
    radius : float, optional
        Where a curve meets a surface at a point, or lies in a solid in space, the radius r of the curve's cross
        section: u grows like ``-log(distance)`` there, and without resistance v is the mean of u at the distance r.

    Raises
    ------
    InputError
        If the resistance is not a number from zero on, or the radius no number above zero.

    Examples
    --------
    >>> import cpmkit as ck
    >>> rod = ck.source("analytic.segment", start=[1, 0, 0], end=[3, 0, 0])
    >>> both = ck.source("union", members=[ck.source("analytic.sphere"), rod])
    >>> warm = {1001: ck.Dirichlet(1.0)}  # the far end of the rod
    >>> scene = ck.Scene(both, ck.ScreenedPoisson(0.0), edge=warm, junctions=ck.Junction(radius=0.05))
    >>> ck.solve(scene, spacing=0.1).evaluate([[2, 0, 0]]).round(2)
    array([0.35])
    """

    resistance: float = 0.0
    radius: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers; raise InputError if they are not accepted."""
        not_negative(self.resistance, "resistance of a junction")
        if self.radius is not None:
            positive(self.radius, "radius of a junction")


@dataclass(frozen=True, eq=False)
class JunctionLaw(Flux):
    """The law of zero flux on a junction's sides, to which the junction adds a flux that depends on u."""

    resistance: float = 0.0  #: That of the junction.
    involves_value: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class JunctionSide(Condition):
    """The condition on a member's cut or edge where a member of another dimension meets it."""

    flux: float = 0.0
    resistance: float = 0.0
    kind: ClassVar[str] = "junction"
    law_kind: ClassVar[type] = JunctionLaw


#: The condition across a point of a curve at which a surface meets it.
CONTINUOUS = Transmission()
#: The law of all junctions of a scene, or of each pair of members, by their numbers in the union.
Junctions = Junction | Mapping[tuple[int, int], Junction]


def check_junctions(given: Any, surface: ClosestPointSource) -> Any:
    """Return the argument ``junctions`` of a scene; raise SceneError if it is not accepted, or names no members."""
    if isinstance(given, Junction):
        return given
    count = len(members_of(surface))
    members = f"the union has the members 0 to {count - 1}" if count > 1 else "the surface is no union"
    entries: Any = given.items() if isinstance(given, Mapping) else [(None, given)]
    for pair, law in entries:
        numbers = isinstance(pair, tuple) and len(pair) == 2 and all(k in range(count) for k in pair)
        if not numbers or not isinstance(law, Junction):
            raise SceneError(
                "junctions must be a ck.Junction, or a table of them by pairs of members of a union, such as "
                f"{{(0, 1): ck.Junction(radius=0.1)}}; leave it out for a continuous u. Got {shown(law)}"
                f"{'' if pair is None else f' for {shown(pair)}'}; {members}."
            )
    return {tuple(sorted(pair)): law for pair, law in entries}


def junction_of(junctions: Junctions, first: int, second: int) -> Junction:
    """Return the law of the junction of two members, by their numbers; by default continuity."""
    if isinstance(junctions, Junction):
        return junctions
    low, high = sorted((first, second))
    return junctions.get((low, high), Junction())


def junctions_in_words(surface: ClosestPointSource, junctions: Junctions) -> list[tuple[str, str, str]]:
    """Return the name, the way the members meet, and the law of each junction of a union, in words."""
    found = []
    for meeting in meetings_of(surface):
        law = junction_of(junctions, meeting.lower, meeting.higher)
        count = len(meeting.places)
        how = f"{count} point{'s' * (count > 1)}" if meeting.how == "points" else meeting.how
        words = f"resistance {law.resistance:g}" if law.resistance else "u is continuous"
        words += f", radius {law.radius:g}" if law.radius is not None and meeting.how in ("points", "inside") else ""
        found.append(
            (f"junction {meeting.lower}/{meeting.higher}", how, f"{words}; what leaves one member enters the other")
        )
    return found


def crossed_member_warnings(scene: Scene) -> tuple[str, ...]:
    """Return a warning for a boundary of a surface that crosses a curve in it without a condition for the curve."""
    members, surface = members_of(scene.surface), scene.surface
    points = [each.source for each in scene.boundaries if each.source.manifold_dim == 0]
    for boundary in scene.boundaries:
        for meeting in meetings_of(surface):
            if boundary.source.manifold_dim != 1 or meeting.how != "along" or largest_dim(members[meeting.lower]) != 1:
                continue
            places = crossings(members[meeting.lower], boundary.source, surface)
            free = [at for at in places if not any(is_near(source, at[None], surface)[0] for source in points)]
            if free and not boundary.condition("left").couples:
                return (
                    f"Boundary {boundary.name!r} crosses member {meeting.lower} of the union near {place(free[0])}, "
                    "and its condition holds on the surface alone; give the curve a condition there, on a point.",
                )
    return ()


def unsupported_junction(surface: ClosestPointSource) -> str:
    """Return in words the first place of a union where members meet in an unsupported way; "" if there is none."""
    members = members_of(surface)
    for meeting in meetings_of(surface):
        dims = [largest_dim(members[number]) for number in (meeting.lower, meeting.higher)]
        pair = f"{_pair_in_words(surface, meeting)} "
        near = f"near {place(meeting.places[0])}"
        if meeting.how == "in part":
            return f"{pair}coincide in part only: divide the first where it leaves the second, {near}"
        if meeting.how == "along" and dims[0] + 1 != dims[1]:
            return f"{pair}meet along a curve, {near}, where u has no limit in a solid"
        if meeting.how == "points" and (dims != [1, 2] or surface.dim == 2):
            return f"{pair}meet, {near}, in a point or along an edge, where u has no limit in a solid"
    return ""


def check_radii(surface: ClosestPointSource, junctions: Junctions) -> None:
    """Raise SceneError if a curve meets a surface at a point, and ``junctions`` do not give the curve's radius.

    Also if the law of all junctions has a radius, and no junction of the union takes one.
    """
    meetings = meetings_of(surface)
    has_place = any(meeting.how in ("points", "inside") for meeting in meetings)
    if isinstance(junctions, Junction) and junctions.radius is not None and not has_place:
        raise SceneError(
            f"the radius of a junction is that of a curve that meets a surface at a point or lies in a solid in space, "
            f"got {junctions.radius:g} where no member does so; leave it out."
        )
    for meeting in meetings:
        law = junction_of(junctions, meeting.lower, meeting.higher)
        if meeting.how in ("points", "inside") and law.radius is None:
            where = f"at a point, near {place(meeting.places[0])}" if meeting.how == "points" else "along the curve"
            raise SceneError(
                f"{_pair_in_words(surface, meeting)} meet {where}, where u grows like the logarithm of the distance: "
                "give the radius r of the curve's cross section, junctions=ck.Junction(radius=r), or use "
                "form='collocation', where the spacing decides what flows."
            )


def _pair_in_words(surface: ClosestPointSource, meeting: Meeting) -> str:
    """Return the numbers and kinds of the members of a ``meeting``."""
    members, dim = members_of(surface), surface.dim
    dims = [largest_dim(members[number]) for number in (meeting.lower, meeting.higher)]
    low, high = (MANIFOLD_WORDS[-1 if each == dim else each] for each in dims)
    return f"members {meeting.lower} ({low}) and {meeting.higher} ({high}) of the union"
