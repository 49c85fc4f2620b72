"""A curve that is known by its closest points alone, as segments."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.grid.band import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.meshing.contouring.knot_crossings import knot_crossings
from cpmkit.meshing.contouring.strand_crossings import with_shared_vertices
from cpmkit.meshing.contouring.trace import Trace, trace_of
from cpmkit.meshing.contouring.trace_laws import BrokenLaws, broken_laws
from cpmkit.protocols import Floats

#: Lattices on which a trace is tried until no law is broken: their side and their shift, in spacings. The shifts are
#: no simple fractions, so that sides and corners of curves do not lie in planes of the lattice.
LATTICES = (
    (1.0, (0.1723, 0.2301, 0.3119)),
    (1.0, (0.4142, 0.0677, 0.1459)),
    (0.5, (0.3371, 0.4561, 0.0823)),
    (0.5, (0.0911, 0.3723, 0.4337)),
    (0.25, (0.1723, 0.2301, 0.3119)),
)


@dataclass(frozen=True)
class CurveReport:
    """What a reader should know of a traced curve.

    Attributes
    ----------
    stars : int
        Vertices in which three segments or more meet: junctions, crossings of a curve with itself.
    ends : int
        Ends of the curve.
    broken : BrokenLaws
        Where the trace is not what a trace has to be; nowhere, mostly.
    """

    stars: int
    ends: int
    broken: BrokenLaws


def traced(source: LocalSource, spacing: float, curved: bool = True) -> tuple[SampleMesh, CurveReport]:
    """Return segments on a curve, with vertices at its ends, corners, junctions and crossings with planes of a lattice.

    Parameters
    ----------
    source : LocalSource
        A curve (m = 1) in the plane or in space. No tangents are asked of it.
    spacing : float
        h, of the form's lattice; the trace is made on lattices of its own, see ``LATTICES``.
    curved : bool
        Whether midpoints of segments are given too, on the curve.

    Raises
    ------
    ResolutionError
        If the curve lies in one cell of the first lattice.
    """
    best = None
    for side, shift in LATTICES:
        found = _traced_on(source, spacing, side * spacing, spacing * np.array(shift[: source.dim]))
        if found is None and best is None:
            raise ResolutionError(
                f"spacing={spacing:g} is too coarse for the curve: it lies in one cell of the lattice; use a smaller "
                "one."
            )
        if found is not None and (best is None or found[1].count < best[1].count):
            best = found
        if best is not None and not best[1].count:
            break
    assert best is not None
    trace, broken = best
    degree = np.bincount(trace.segments.ravel(), minlength=len(trace.vertices))
    mesh = SampleMesh.of(trace.vertices, trace.segments, trace.midpoints[:, None] if curved else None)
    return mesh, CurveReport(int((degree > 2).sum()), int((degree == 1).sum()), broken)


def _traced_on(source: LocalSource, spacing: float, side: float, shift: Floats) -> tuple[Trace, BrokenLaws] | None:
    """Return the trace on the lattice with a cell centred at ``shift`` (d,); None where that has no segment."""
    shifted = replace(source, shift=source.shift + shift)
    for _, found in cell_levels(shifted, side, 0.5):
        cells = found
    crossings = knot_crossings(shifted, cells, side)
    if not len(crossings.points):
        return None
    trace = trace_of(shifted, crossings, side)
    if not len(trace.segments):
        return None
    trace = with_shared_vertices(shifted, trace, spacing)
    feet = shifted.closest_point(np.asarray(cells * side)).points
    broken = broken_laws(trace, feet, spacing)
    return trace.moved(shift), broken.moved(shift)
