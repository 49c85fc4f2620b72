"""The kind ``trimmed``: the part of a surface or curve where a function of position is at most zero."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import ClosestPoints, ClosestPointSource, cell_levels, norms
from cpmkit_combinations.cut import check_cuttable, cut_of, level_cut
from cpmkit_combinations.level_cut import CUT_DIFFERENCE_SHARE, LevelCut
from cpmkit_combinations.points import PointSet
from cpmkit_combinations.position_function import PositionFunction, position_function
from cpmkit_combinations.rim import CurveRim, MeshRim, point_rim
from cpmkit_combinations.trimmed_part import Trimmed
from cpmkit_combinations.wrapper import with_abilities

#: A foot closer to the edge than this, relative to the size, or than four times the edge's deviation, lies on it.
ON_TRIMMED_EDGE_SHARE = 1e-11
#: How much coarser than those that find the edge the samples are that tell which parts of the manifold are near.
COARSE_SAMPLE_FACTOR = 2
#: A point of the manifold is within this many sample distances of a sample.
COVERING_SAMPLE_DISTANCES = 1.75


def trimmed(*, of: ClosestPointSource, trim: Any, resolution: int | None = None) -> Any:
    """Return the part of a surface or curve where a function of position is at most zero, with a true edge.

    Parameters
    ----------
    of : source
        The whole: a surface, or a curve of which one piece is to be left.
    trim : str or callable
        A formula in x, y, z, or a function of points (n, d) that returns (n,). The part with trim <= 0 is kept.
    resolution : int, optional
        Samples along the largest side with which the edge is looked for, as for the kind ``cut.function``.

    Raises
    ------
    InputError
        If an argument is not accepted, nothing is cut off or nothing is left, the edge branches, or of a curve more
        than one piece would be left.

    Examples
    --------
    >>> import numpy as np, cpmkit as ck
    >>> bowl = trimmed(of=ck.source("analytic.sphere"), trim="z")
    >>> feet = bowl.closest_point(np.array([[0.6, 0.0, 0.8], [0.6, 0.0, -0.8]]))
    >>> feet.points[:, [0, 2]].round(12).tolist(), feet.edge.tolist()
    ([[1.0, 0.0], [0.6, -0.8]], [0, -1])
    """
    check_cuttable(of, "of")
    function = position_function(trim, of.dim, "trim")
    cut = level_cut(of, function, "trim", resolution)
    where = cut_of(cut)
    samples = _kept_samples(cut)
    own_ends = np.unique(samples.edge[samples.edge >= 0])
    rim: MeshRim = point_rim(cut, where, own_ends) if isinstance(where, PointSet) else CurveRim(where)
    tolerance = max(ON_TRIMMED_EDGE_SHARE * cut.size, 4 * rim.deviation)
    along = where.mesh(cut.spacing)[0] - cut.phi.origin
    steepest = float(norms(cut.phi.gradient(along, CUT_DIFFERENCE_SHARE * cut.size)).max())
    covering = COVERING_SAMPLE_DISTANCES * COARSE_SAMPLE_FACTOR * cut.spacing
    target = PositionFunction(function, np.zeros(of.dim), "trim")
    kept = samples.points + cut.phi.origin
    return with_abilities(Trimmed, "trimmed", of)(of, target, rim, kept, covering, steepest * tolerance, tolerance)


def _kept_samples(cut: LevelCut) -> ClosestPoints:
    """Return samples of the part that is kept, the ends of a curve among them."""
    spacing = COARSE_SAMPLE_FACTOR * cut.spacing
    cells = next(blocks for side, blocks in cell_levels(cut.surface, spacing, 0.5) if side == 1)
    if cut.surface.manifold_dim == 1:  # the foot of a cell may miss the end in it, that of one beside it does not
        beside = np.stack(np.meshgrid(*[np.arange(-1, 2)] * cut.surface.dim, indexing="ij"), axis=-1)
        cells = np.unique((cells[:, None] + beside.reshape(-1, cut.surface.dim)).reshape(-1, cut.surface.dim), axis=0)
    feet = cut.surface.closest_point(np.asarray(cells * spacing, dtype=np.float64))
    return feet.take(cut.phi(feet.points) <= 0)
