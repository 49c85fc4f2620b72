"""How fine a lattice a time and a memory allow, foretold from what was solved before."""

from __future__ import annotations

import numpy as np

from cpmkit.accuracy.way import Run, Way
from cpmkit.errors import ResolutionError
from cpmkit.forms.choice import cost_model
from cpmkit.forms.cost_model import Growth, line_through, rising_growth
from cpmkit.forms.options import lattice_options
from cpmkit.grid.fitting import unknowns_at_one
from cpmkit.grid.lattice import COARSEST_SPACING_SHARE
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Unknowns of the first pilot, about, by the manifold's dimension.
FIRST_UNKNOWNS = {0: 35, 1: 35, 2: 100, 3: 400}
#: Blocks of the manifold by which these are counted: few, for closest points may be dear.
COUNTED_BLOCKS = 100
#: A solve may take so many times longer than foretold.
LONGER = 1.25
#: Of the memory that there is, and of that asked for, this share is planned with.
PLANNED_SHARE = 0.8
#: Where one solve follows another, holes between arrays and pages of 2 MiB that are used in part: so many bytes, and so
#: much again of what is needed, up to so many (measured on 24 problems of 500 to 58,000 unknowns: .1 of it, 20 MB at
#: most, in processes of their own, and 1 to 2 times as much, 50 MB at most, after many solves; this is the middle).
PAGED_BYTES, PAGED_SHARE, MOST_PAGED_BYTES = 3e6, 0.4, 20e6
#: Rounds in which bytes, which grow faster than unknowns beside factors, are brought to the limit.
FITTING_ROUNDS = 20


def first_spacing(scene: Scene) -> float:
    """Return the spacing of the first pilot."""
    surface = localize(scene.surface, np.zeros(scene.surface.dim))
    m = surface.largest_dim
    spacing = (unknowns_at_one(surface, 2, COUNTED_BLOCKS) / FIRST_UNKNOWNS[m]) ** (1 / max(m, 1))
    return float(min(spacing, COARSEST_SPACING_SHARE * np.ptp(surface.bounds, axis=0).max()))


def finest_spacing(way: Way) -> float:
    """Return the finest spacing that time and memory allow: those asked for, and the memory that there is."""
    most = min(_most_in_memory(way), _most_in_time(way))
    return spacing_with(way, most)


def expected_seconds(way: Way, spacing: float) -> float | None:
    """Return how long a solve at a spacing will take, about; None before two were timed."""
    if len(way.runs) < 2:
        return None
    start, each = _seconds(way)
    return start + each * unknowns_at(way, spacing)


def predicted_bytes(way: Way, unknowns: float) -> float:
    """Return the memory at the peak of a solve of so many unknowns, pages and holes included."""
    used, held = _needed(way, unknowns)
    return held + used + min(PAGED_BYTES + PAGED_SHARE * used, MOST_PAGED_BYTES)


def _needed(way: Way, unknowns: float) -> tuple[float, float]:
    """Return the bytes that a solve of so many unknowns needs, and those that coarser ones hold meanwhile."""
    options = lattice_options(way.last.solution.discretized)
    assert options is not None  # what a way solves is on a lattice
    model = cost_model(way.scene, options)
    used = model.peak_bytes(unknowns, model.choose_solver(way.solver, unknowns), way.last.solution.work)
    return used, sum(model.held_bytes(run.solution.work) for run in way.runs if run.unknowns < unknowns)


def check_memory(way: Way) -> None:
    """Refuse a memory that coarse solves exceed.

    Raises
    ------
    ResolutionError
        With what they need.
    """
    needed, target = sum(_needed(way, way.last.unknowns)), way.target.memory
    if target is not None and needed > target:
        raise ResolutionError(
            f"memory={target:.3g} bytes are less than the {needed:.3g} of a coarse solve with {way.last.unknowns:,} "
            "unknowns; ask for more."
        )


def unknowns_at(way: Way, spacing: float) -> float:
    """Return about how many unknowns there will be."""
    return _growth(way).at(spacing)


def spacing_with(way: Way, unknowns: float) -> float:
    """Return the spacing with so many unknowns."""
    return _growth(way).spacing_with(unknowns)


def _growth(way: Way) -> Growth:
    coarse, fine = ((float(run.spacing), float(run.unknowns)) for run in _last_two(way))
    return rising_growth(fine, coarse, max(largest_dim(way.scene.surface), 1))


def _last_two(way: Way) -> tuple[Run, Run]:
    """Return the finest run, and the next one that is coarser."""
    fine = way.last
    return next(run for run in reversed(way.runs) if run.spacing > 1.1 * fine.spacing), fine


def _seconds(way: Way) -> tuple[float, float]:
    """Return seconds to begin with and those for each unknown, a line through the last two runs."""
    coarse, fine = ((float(run.unknowns), run.seconds) for run in _last_two(way))
    return line_through(coarse, fine)


def _most_in_time(way: Way) -> float:
    """Return how many unknowns fit into what is left of the time, with a companion of twice the spacing."""
    if way.target.seconds is None:
        return np.inf
    start, each = _seconds(way)
    m = max(largest_dim(way.scene.surface), 1)
    left = (way.target.seconds - way.elapsed) / LONGER
    beside = 0.0 if way.runs[-1].purpose == "companion" else 0.5**m
    return max((left - start * (1 + (beside > 0))) / (each * (1 + beside)), 1.0)


def _most_in_memory(way: Way) -> float:
    """Return how many unknowns the memory holds."""
    limit = PLANNED_SHARE * min(way.target.memory or np.inf, memory.available_bytes())
    most = float(way.last.unknowns)
    for _ in range(FITTING_ROUNDS):
        most = max(limit * most / predicted_bytes(way, most), 1.0)
    return most
