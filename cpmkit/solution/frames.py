"""Solutions of problems in time: that at the end, and those kept on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError
from cpmkit.runtime.memory import available_bytes
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: Bytes of a value, and how often frames are in memory while they are saved.
VALUE_BYTES, FRAME_COPIES = 8, 2


def check_frames_fit(frames: int, unknowns: int, channels: int) -> None:
    """Refuse, before the first step, more frames than the memory that is left would hold.

    Raises
    ------
    ResolutionError
        With the number of frames that would fit.
    """
    each, available = FRAME_COPIES * VALUE_BYTES * unknowns * channels, available_bytes()
    if frames * each > available:
        raise ResolutionError(
            f"{frames} frames of {unknowns} unknowns need {frames * each / 2**30:.3g} GiB, and "
            f"{available / 2**30:.3g} GiB are available; ask for {available // (2 * each)} frames or less."
        )


@dataclass(frozen=True, eq=False)
class EvolvedRecord(SolutionRecord):
    """The solution of a problem in time, at one time; read, saved and drawn as any other.

    Attributes
    ----------
    time : float
        When it holds.
    steps : int
        Steps that led there.
    energy : (channels,) float64, optional
        Of a wave in a form with symmetric operators: kinetic and elastic energy, less the work of what pushes it.
    frames : tuple of EvolvedSolution
        The solutions at the times that ``frames`` of the problem names, in order; they share all tables.
    """

    time: float = field(kw_only=True)
    steps: int = field(kw_only=True)
    energy: Floats | None = field(default=None, kw_only=True)
    frames: tuple[EvolvedRecord, ...] = field(default=(), kw_only=True)

    @property
    def data_time(self) -> float:
        """When the solution holds."""
        return self.time

    @property
    def totals(self) -> Floats | None:
        """(channels,) the integrals of u over the manifold, such as its heat; None in forms that know no exact ones."""
        return self.discretized.integrals(self.values)

    def frame_meshes(self) -> list[DisplayMesh]:
        """Return the display mesh of each frame: one mesh, cut and read once, with the values of each."""
        together = np.concatenate([frame.values for frame in self.frames], axis=1)
        mesh = replace(self, values=together, frames=()).display_mesh()
        parts = np.split(mesh.values, len(self.frames), axis=1)
        return [replace(mesh, values=np.ascontiguousarray(part)) for part in parts]

    def summary(self) -> dict[str, Any]:
        """Return what was solved, what it cost and what it reached, as plain values."""
        problem = self.scene.problem
        told: dict[str, Any] = {"time": self.time, "steps": self.steps}
        if isinstance(problem, Evolution):
            told |= {
                "scheme": problem.with_scheme("explicit steps" not in self.discretized.cannot).scheme,
                "step": problem.step,
            }
        told["frames"] = [frame.time for frame in self.frames]
        for name in ("totals", "energy"):  # of each frame, and at the end
            values = [getattr(one, name) for one in (*self.frames, self)]
            told |= {} if values[-1] is None else {name: [value.tolist() for value in values]}
        return {**super().summary(), "time": told}

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of the discrete solution, with the times and the values of the frames."""
        times = np.array([frame.time for frame in self.frames])
        frames = np.stack([frame.values for frame in self.frames]) if self.frames else np.zeros((0, *self.values.shape))
        return {**super().arrays(), "time": np.array(self.time), "frame_times": times, "frames": frames}

    def _figures(self) -> list[tuple[str, str]]:
        kept = f", {len(self.frames)} frames" if self.frames else ""
        return [*super()._figures(), ("time", f"{self.time:g} after {self.steps} steps{kept}")]

    def __repr__(self) -> str:
        kept = f", {len(self.frames)} frames" if self.frames else ""
        return f"{super().__repr__()}, time {self.time:g} after {self.steps} steps{kept}"


def frames_of(solution: SolutionRecord, what: str) -> tuple[EvolvedRecord, ...]:
    """Return the frames of a solution.

    Raises
    ------
    InputError
        If it has none.
    """
    frames = solution.frames if isinstance(solution, EvolvedRecord) else ()
    if not frames:
        raise InputError(
            f"{what} needs frames, and the solution has none; ask the problem for some, such as Heat(..., frames=10)."
        )
    return frames
