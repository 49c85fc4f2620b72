"""Solutions of problems in time: the solution at the end, and frames at earlier times."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.contract import integrals
from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class EvolvedRecord(SolutionRecord):
    """The solution of a problem in time, at one time; read, saved and drawn as any other."""

    time: float = field(kw_only=True)  #: Time of the solution.
    steps: int = field(kw_only=True)  #: Number of time steps up to that time.
    #: (channels,): for a wave, if operators are symmetric: kinetic and elastic energy, minus the work of the load.
    energy: Floats | None = field(default=None, kw_only=True)
    #: The solutions at the times in ``frames`` of the equation, in order; they share the discretised scene.
    frames: tuple[EvolvedRecord, ...] = field(default=(), kw_only=True)

    @property
    def data_time(self) -> float:
        """Time of the solution, at which data that depend on the time are evaluated."""
        return self.time

    @property
    def totals(self) -> Floats | None:
        """Integrals (channels,) of u, or b u with a capacity b, such as the heat; None without exact integrals."""
        capacity: Any = self.scene.problem.terms().capacity
        if not callable(capacity) and capacity == 1:
            return integrals(self.discretized, self.values)
        form: Any = self.discretized  # a Galerkin form: others refuse a capacity
        return np.asarray((form.constant.T @ form.mass_in_time.apply(self.values))[0])

    def of_dimension(self, dim: int) -> Self:
        """Return the solution, and its frames, on the members of dimension ``dim``; see `SolutionRecord`."""
        frames = tuple(frame.of_dimension(dim) for frame in self.frames)
        return replace(super().of_dimension(dim), frames=frames, energy=None)

    def frame_meshes(self) -> list[DisplayMesh]:
        """Return a display mesh for each frame, which differ in their values alone; there must be a frame."""
        all_values = np.concatenate([frame.values for frame in self.frames], axis=1)
        mesh = replace(self, values=all_values, frames=()).display_mesh()
        parts = np.split(mesh.values, len(self.frames), axis=1)
        return [replace(mesh, values=np.ascontiguousarray(part)) for part in parts]

    def summary(self) -> dict[str, Any]:
        """Return the plain values of :meth:`SolutionRecord.summary`, and under "time" those of the run and frames."""
        problem: Any = self.scene.problem
        summary: dict[str, Any] = {"time": self.time, "steps": self.steps}
        if problem.family == "time":
            summary |= {
                "scheme": problem.with_scheme("explicit steps" not in self.discretized.cannot).scheme,
                "step": problem.step,
            }
        summary["frames"] = [frame.time for frame in self.frames]
        for name in ("totals", "energy"):  # of each frame, then at the end
            values = [getattr(solution, name) for solution in (*self.frames, self)]
            summary |= {} if values[-1] is None else {name: [value.tolist() for value in values]}
        return {**super().summary(), "time": summary}

    def arrays(self) -> dict[str, Any]:
        """Return the record's arrays, and ``time`` (), ``frame_times`` (f,), ``frames`` (f, unknowns, channels)."""
        times = np.array([frame.time for frame in self.frames])
        frames = np.stack([frame.values for frame in self.frames]) if self.frames else np.zeros((0, *self.values.shape))
        return {**super().arrays(), "time": np.array(self.time), "frame_times": times, "frames": frames}

    def _notebook_rows(self) -> list[tuple[str, str]]:
        """Return the rows of :meth:`SolutionRecord._notebook_rows`, and one with the time."""
        frames = f", {len(self.frames)} frames" if self.frames else ""
        return [*super()._notebook_rows(), ("time", f"{self.time:g} after {self.steps} steps{frames}")]

    def __repr__(self) -> str:
        frames = f", {len(self.frames)} frames" if self.frames else ""
        return f"{super().__repr__()}, time {self.time:g} after {self.steps} steps{frames}"


def frames_of(solution: SolutionRecord, label: str) -> tuple[EvolvedRecord, ...]:
    """Return the frames of a solution: solutions at the stored times, in ascending order.

    Raises InputError, in which ``label`` names their use, if the solution has none.
    """
    frames = solution.frames if isinstance(solution, EvolvedRecord) else ()
    if not frames:
        raise InputError(
            f"{label} needs frames, and the solution has none; request them from a problem in time, such as "
            "Heat(..., frames=10)."
        )
    return frames
