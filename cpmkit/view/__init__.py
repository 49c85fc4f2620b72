"""Pictures of solutions: through OpenGL where it answers, else with matplotlib."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.files.whole_files import written_whole
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.installing import to_install
from cpmkit.view.camera import Direction, axes_of, fit
from cpmkit.view.drawing import FIELDS, Drawing, draw

if TYPE_CHECKING:
    from cpmkit.solution.solution import Solution

#: Seconds after which a renderer that has not answered is given up.
RENDERER_SECONDS = 120.0


@dataclass(frozen=True)
class Picture:
    """A picture that was drawn.

    Attributes
    ----------
    file : Path
        The PNG file.
    renderer : str
        Which renderer drew it.
    reason : str
        Why OpenGL did not, empty where it did.
    """

    file: Path
    renderer: Literal["opengl", "matplotlib"]
    reason: str


def picture(
    solution: Solution,
    path: str | Path,
    width: int = 1200,
    view: Direction = None,
    up: Direction = None,
    curves: bool = True,
    span: tuple[float, float] | None = None,
    twins: bool = False,
    field: str = FIELDS[0],
) -> Picture:
    """Draw a solution, or how large its error is, into a PNG file.

    Three channels are shown as the colour that they are, clipped to [0, 1]; of any other number
    the first is shown in viridis beside a colour bar.

    Parameters
    ----------
    solution : Solution
        What to draw. Its surface must have a mesh; boundaries are drawn if theirs has one.
    path : str or Path
        Where the picture goes; must end in ``.png``.
    width : int
        Width of the picture in pixels; the height follows from the model.
    view : three numbers, optional
        The direction from the model to the camera. Not used in the plane.
    up : three numbers, optional
        What points upwards in the picture; z unless given.
    curves : bool
        Whether boundaries are drawn, as dark lines and dots.
    span : two numbers, optional
        The values at the ends of the colour bar; the least and the greatest of the solution unless given.
    twins : bool
        Whether dots show where nodes are doubled, because several sheets of the surface share them.
    field : str
        ``"solution"``, or ``"error"``: its estimated error in the solution's own unit, of several channels the largest,
        which is made first where there is none yet.

    Raises
    ------
    InputError
        If the surface has no mesh, or an argument is not what is accepted.
    MissingDependencyError
        If matplotlib, which draws where OpenGL does not, is not installed.
    """
    path = check_picture(path, width, view, up)
    if field not in FIELDS:
        raise InputError(f"field of a picture must be {' or '.join(map(repr, FIELDS))}, got {shown(field)}.")
    drawing = draw(solution, width, view, up, curves, span, twins, field)
    planar = "pictures in the plane need no OpenGL" if solution.scene.surface.dim == 2 else ""
    with written_whole(path) as unfinished:
        reason = planar or _opengl(drawing, unfinished)
        if reason:
            from cpmkit.view import software

            software.render(drawing, unfinished)
    return Picture(path, "matplotlib" if reason else "opengl", reason)


def check_picture(path: str | Path, width: int = 1200, view: Direction = None, up: Direction = None) -> Path:
    """Return ``path`` if a picture can be drawn into such a file here.

    Raises
    ------
    InputError
        If it does not end in ``.png``, ``width`` is not a number of pixels, or ``view`` and ``up`` are no camera's.
    MissingDependencyError
        If matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"A picture must be a .png file, got {shown(path.name)}.")
    whole(width, "width in pixels", 16, 16384)
    axes_of(view, up)
    if find_spec("matplotlib") is None:
        raise MissingDependencyError(f"Pictures need matplotlib and pyvista; {to_install('view')} adds them.")
    return path


def probe() -> str:
    """Draw one small triangle through OpenGL; return why that failed, empty if it did not."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]])
    triangle = Drawing(
        points=points,
        triangles=np.array([[0, 1, 2]]),
        segments=np.zeros((0, 2), dtype=np.int64),
        colours=np.zeros((3, 3)),
        normals=np.zeros((0, 3)),
        curve_points=np.zeros((0, 3)),
        curve_cells=np.zeros((0, 2), dtype=np.int64),
        pins=np.zeros((0, 3)),
        width=np.array(32),
        span=np.zeros(0),
        **vars(fit(points, 32)),
    )
    with tempfile.TemporaryDirectory() as folder:
        return _opengl(triangle, Path(folder, "probe.png"))


def environment(inherited: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of the OpenGL process: without a display VTK is told to use EGL.

    Otherwise it would first look for an X server and complain that there is none.
    """
    headless = not inherited.get("DISPLAY") and not inherited.get("WAYLAND_DISPLAY")
    egl = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"} if headless and sys.platform == "linux" else {}
    return {**egl, **inherited}


def _opengl(drawing: Drawing, path: Path) -> str:
    """Draw through OpenGL in a process of its own; return why that failed, empty if it did not."""
    if find_spec("pyvista") is None:
        return "pyvista is not installed"
    with tempfile.TemporaryDirectory() as folder:
        order, answer = Path(folder, "drawing.npz"), Path(folder, "picture.png")
        drawing.save(order)
        # -P: else `-m` would put the working directory first, and a numpy.py that lies there would be run
        command = [sys.executable, "-P", "-m", "cpmkit.view.opengl", str(order), str(answer)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=RENDERER_SECONDS,
                env=environment(os.environ),
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"the OpenGL process did not answer within {RENDERER_SECONDS:.0f} seconds"
        if done.returncode != 0 or not answer.is_file():
            return _reason(done)
        if len(drawing.span):
            from cpmkit.view import software

            software.add_colour_bar(drawing, answer, path)
        else:
            path.write_bytes(answer.read_bytes())
    return ""


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return f"the OpenGL process was ended by {signal.Signals(-done.returncode).name}"
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    return f"the OpenGL process failed: {lines[-1]}"
