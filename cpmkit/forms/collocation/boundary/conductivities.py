"""The conductivities on the two sides of a transmission: those of the problem, unless the condition gives them."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError, SceneError, place
from cpmkit.forms.collocation.boundary.side_view import SideView
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import Bools, Floats
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.laws import Interface

#: A diffusivity is read so many spacings beside the boundary, and twice as far: a curve that is snapped to the surface
#: lies nearer to where the materials meet than that.
READ_BESIDE_SPACINGS = (0.25, 0.5)
#: Readings whose logarithms differ by less are of one material, and are continued to the boundary.
SAME_MATERIAL_LOG_RATIO = 0.4
#: What is given may differ from the problem's diffusivity by this share of it.
DIFFUSIVITY_MISMATCH_SHARE = 0.01
#: Share of a boundary's points that may be misread, where it meets other boundaries.
MISREAD_POINTS_SHARE = 0.1


def conductivities(
    law: Interface, diffusivity: Data, side_view: SideView, carries_left: Bools, lattice: Lattice
) -> tuple[Floats, Floats]:
    """Return the conductivities (n,) on the side on which ghosts stand, and on the side that they carry."""
    given = (diffusivity if one is None else one for one in (law.left, law.right))
    left, right = (
        _continued_to_boundary(one, side_view, sign, lattice) for one, sign in zip(given, (1, -1), strict=True)
    )
    return np.where(carries_left, right, left), np.where(carries_left, left, right)


def check_conductivities(what: str, law: Interface, diffusivity: Data, side_view: SideView, lattice: Lattice) -> None:
    """Refuse conductivities of an interface that are not those of the problem beside the boundary.

    Raises
    ------
    SceneError
        Naming the side, and the place where they differ most.
    """
    for side, given, sign in (("left", law.left, 1.0), ("right", law.right, -1.0)):
        if given is None or not len(side_view.rows):
            continue
        wanted = _continued_to_boundary(given, side_view, sign, lattice)
        near = [_data_beside(diffusivity, side_view, sign * share, lattice) for share in READ_BESIDE_SPACINGS]
        near.append(_continued_to_boundary(diffusivity, side_view, sign, lattice))
        off = np.min([np.abs(wanted / one - 1) for one in near], axis=0)
        if np.mean(off > DIFFUSIVITY_MISMATCH_SHARE) <= MISREAD_POINTS_SHARE:
            continue
        worst = int(off.argmax())
        where = place(lattice.to_scene(side_view.foot[[worst]])[0])
        raise SceneError(
            f"{what} gives the conductivity {wanted[worst]:.4g} on its {side} near {where}, where the problem's "
            f"diffusivity is {near[-1][worst]:.4g}; leave `{side}` out, or give the problem that diffusivity."
        )


def _continued_to_boundary(data: Data, side_view: SideView, sign: float, lattice: Lattice) -> Floats:
    """Return data (n,) at the boundary, continued from one side: to second order where they are smooth there."""
    if not callable(data):
        return _data_beside(data, side_view, 0.0, lattice)
    near, far = (np.log(_data_beside(data, side_view, sign * share, lattice)) for share in READ_BESIDE_SPACINGS)
    return np.asarray(np.exp(np.where(np.abs(near - far) < SAME_MATERIAL_LOG_RATIO, 2 * near - far, far)))


def _data_beside(data: Data, side_view: SideView, share: float, lattice: Lattice) -> Floats:
    """Return data (n,) so many spacings to the left of the boundary."""
    points = lattice.to_scene(side_view.foot + share * lattice.spacing * side_view.conormal)
    values = evaluate_data(data, points, 1, "a conductivity of Transmission, or the diffusivity,")[:, 0]
    if np.any(values <= 0):
        raise InputError(f"the diffusivity must be above zero, got {values.min():g}.")
    return values
