"""Features of a surface that the spacing does not resolve: their share, the expected error, the remedy.

The numbers behind the expected errors are in docs/explanation/sheets.md. They are shares of the range of a solution
that varies on the scale of the surface and has a flux across the feature; without such a flux the error is much
smaller.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from cpmkit.errors import place

#: Features expected to cost at least this share of the range of a solution are reported: the fish, the koala, Spot and
#: Nefertiti at 7,000 to 30,000 unknowns, which differ from finite elements by 0.8 to 2.4 percent, and the Dziuk surface
#: at a spacing of twice its smallest radius, but not at one of that radius.
TOLD_ERROR_SHARE = 5e-3


@dataclass(frozen=True)
class UnresolvedFeature:
    """One feature of the surface that the band does not resolve.

    Attributes
    ----------
    kind : "crease", "bend", "limbs", "sheets" or "lost"
        Limbs are parts side by side, across a valley; lost are nodes for which no foot on the stencil's sheet was
        found.
    share : float
        Of the surface.
    typical, worst : float
        Angles in degrees of creases, radii of bends, distances between limbs and sheets; 0 for what is lost.
    error : float
        To be expected, as a share of the range of the solution.
    cure : float or None
        The spacing at which it is gone; None where no spacing is known to help.
    place : tuple of float
        Where it is worst, in the scene's coordinates.
    """

    kind: str
    share: float
    typical: float
    worst: float
    error: float
    cure: float | None
    place: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)

    @property
    def name(self) -> str:
        """What it is called in an explanation."""
        return {
            "crease": "creases",
            "bend": "sharp bends",
            "limbs": "limbs side by side",
            "sheets": "close sheets",
            "lost": "feet not found",
        }[self.kind]

    @property
    def sentence(self) -> str:
        """What a reader of the solution should know."""
        where = f"near {place(self.place)}"
        harm = f"about {self.error:.1%} of the solution's range, where it flows across"
        if self.kind == "crease":
            return (
                "The surface has creases. Beside them the solution is less exact, and a smaller spacing hardly lessens "
                f"that: expect an error of {harm}. The surface turns at one place by {self.typical:.0f} degrees "
                f"typically, by {self.worst:.0f} at most {where}; {self.share:.1%} of it lies within a stencil's reach "
                "of a crease."
            )
        if self.kind == "bend":
            return (
                "Part of the surface bends more sharply than the band is wide, and the solution is less exact there; a "
                f"spacing of {self.cure:.2g} resolves most of it. That part is {self.share:.1%} of the surface, with a "
                f"radius of {self.typical:.3g} typically, of {self.worst:.3g} at the sharpest {where}; expect an error "
                f"of {harm}."
            )
        if self.kind == "limbs":
            return (
                "Limbs side by side read each other across the valley between them, so that values of one show on the "
                f'other; a spacing of {self.cure:.2g} parts them, and so may sheets="unfolded". The valley is '
                f"{self.worst:.3g} wide where it is worst {where}, {self.typical:.3g} typically, on {self.share:.1%} "
                f"of the surface; expect an error of about {self.error:.1%} of the solution's range where they differ."
            )
        if self.kind == "sheets":
            return (
                "Two sheets of the surface are too near to each other to be parted, so that values of one show on the "
                f"other; a spacing of {self.cure:.2g} parts them. They are {self.typical:.3g} apart typically, "
                f"{self.worst:.3g} at least {where}, on {self.share:.1%} of the surface; expect an error of about "
                f"{self.error:.1%} of the solution's range where values differ."
            )
        return (
            "In places stencils read nodes of a sheet that is not theirs, because no foot on their own was found; a "
            f"smaller spacing narrows the band. These are {self.share:.1%} of the surface, for one {where}; expect an "
            f"error of about {self.error:.1%} of the solution's range."
        )
