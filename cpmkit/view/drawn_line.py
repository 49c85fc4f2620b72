"""A line that is drawn on a surface click by click: put on the surface, filled in between, and written to a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import written_whole
from cpmkit.protocols import ClosestPointSource, Floats

#: Neighbouring points of a line that are farther apart than so many steps are not on one stretch of the surface.
LARGEST_GAP_STEPS = 4.0
#: A click nearer to the last one than this share of a step is the same again.
SAME_CLICK_STEPS = 1e-6
#: Files that the kind mesh.polyline reads.
LINE_SUFFIXES = (".csv", ".obj", ".npy")


@dataclass(frozen=True, eq=False)
class DrawnLine:
    """The points that were clicked on a surface, in the order of travel.

    Attributes
    ----------
    surface : ClosestPointSource
    step : float
        How far apart neighbouring points of the line are at most, where the surface is flat.
    clicks : (k, d) float64
        On the surface.
    closed : bool
        Whether the last leads back to the first.
    """

    surface: ClosestPointSource
    step: float
    clicks: Floats
    closed: bool = False

    @cached_property
    def points(self) -> Floats:
        """(n, d) points on the surface, the clicks among them; of a closed line the first is also the last."""
        ends = np.concatenate([self.clicks, self.clicks[:1]]) if self.closed and len(self.clicks) > 1 else self.clicks
        if len(ends) < 2:
            return ends
        counts = np.maximum(np.ceil(np.linalg.norm(np.diff(ends, axis=0), axis=1) / self.step), 1).astype(np.int64)
        start = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[start]
        chords = ends[start] + share[:, None] * (ends[start + 1] - ends[start])
        return np.concatenate([self.surface.closest_point(chords).points, ends[-1:]])

    def clicked(self, point: Floats) -> DrawnLine:
        """Return the line with one point more, the surface's nearest to ``point`` (d,) or, in the plane, (3,).

        Raises
        ------
        InputError
            If the way there from the last point leaves the surface: between the two it would jump.
        """
        place = np.asarray(point, dtype=np.float64)[None, : self.surface.dim]
        foot = self.surface.closest_point(np.ascontiguousarray(place)).points
        if len(self.clicks) and np.linalg.norm(foot[0] - self.clicks[-1]) <= SAME_CLICK_STEPS * self.step:
            return self
        check_way(replace(self, clicks=np.concatenate([self.clicks[-1:], foot]), closed=False))
        return replace(self, clicks=np.concatenate([self.clicks, foot]))

    def without_last(self) -> DrawnLine:
        """Return the line without its last click."""
        return replace(self, clicks=self.clicks[:-1])

    def finished(self) -> Floats:
        """Return its points (n, d).

        Raises
        ------
        InputError
            If it has fewer than two clicks, or three where it is closed, or its end does not lead back to its start.
        """
        least = 3 if self.closed else 2
        if len(self.clicks) < least:
            sort = "a closed line" if self.closed else "a line"
            raise InputError(f"{sort} needs {least} points at least, and {len(self.clicks)} were picked.")
        check_way(self)
        return self.points


def start_line(surface: ClosestPointSource, step: float, closed: bool = False) -> DrawnLine:
    """Return a line on ``surface`` without a point.

    Raises
    ------
    InputError
        If it is no surface.
    """
    if surface.manifold_dim not in (2, None):
        what = {0: "points", 1: "a curve"}.get(surface.manifold_dim, "a solid")
        raise InputError(f"lines are drawn on surfaces, and this is {what}.")
    return DrawnLine(surface, step, np.zeros((0, surface.dim)), closed)


def check_way(line: DrawnLine) -> None:
    """Refuse a line that jumps."""
    gaps = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
    if len(gaps) and gaps.max() > LARGEST_GAP_STEPS * line.step:
        near = ", ".join(f"{x:.4g}" for x in line.points[int(gaps.argmax())])
        raise InputError(
            f"the straight way between two points leaves the surface near ({near}); pick one between them."
        )


def check_line_file(path: str | Path, surface: ClosestPointSource) -> Path:
    """Return the path of a file to which a line on ``surface`` can be written.

    Raises
    ------
    InputError
        If its suffix is none of those accepted, or it is an OBJ file and the surface is in the plane.
    """
    path = Path(path)
    if path.suffix.lower() not in LINE_SUFFIXES:
        raise InputError(f"A line is saved as {', '.join(LINE_SUFFIXES)}, got {shown(path.name)}.")
    if path.suffix.lower() == ".obj" and surface.dim == 2:
        raise InputError("OBJ files hold points of space, and the line is in the plane; use .csv.")
    return path


def write_line(points: Floats, path: Path) -> None:
    """Write points (n, d) so that the kind ``mesh.polyline`` reads them: a file that is there is replaced."""
    rows = [[f"{x:.17g}" for x in point] for point in points.tolist()]
    with written_whole(path) as unfinished:
        if path.suffix.lower() == ".npy":
            with unfinished.open("wb") as file:
                np.save(file, points)
        elif path.suffix.lower() == ".csv":
            unfinished.write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
        else:
            closed = len(points) > 1 and bool((points[0] == points[-1]).all())
            kept = rows[:-1] if closed else rows
            numbers = [*range(1, len(kept) + 1), *([1] if closed else [])]
            text = "".join("v " + " ".join(row) + "\n" for row in kept) + "l " + " ".join(map(str, numbers)) + "\n"
            unfinished.write_text(text, encoding="utf-8")
