"""What works with the core, one plugin and no extras: a circle, a scene file, the README's scene.

A missing extra is named.
"""

from __future__ import annotations

import json
import re
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import MissingDependencyError

SCENE = """
[surface]
kind = "analytic.circle"

[[boundary]]
name = "cut"
kind = "analytic.point"
at = [1, 0]
left = { dirichlet = 1.0 }
right = { dirichlet = 0.0 }

[problem]
kind = "laplace"

[discretization]
spacing = 0.05

[output]
files = [FILES]
"""


def from_python() -> None:
    """Solve a circle that is cut at a point; u grows with the angle."""
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [cut])
    angles = np.linspace(0.1, 6.1, 50)
    values = ck.solve(scene, spacing=0.05).evaluate(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    assert np.abs(values - angles / (2 * np.pi)).max() < 1e-3


def from_file(folder: Path) -> None:
    """Solve the same from a scene file; a file that needs an extra is refused before anything is solved."""
    scene = folder / "circle.toml"
    scene.write_text(SCENE.replace("FILES", '"solution.npz", "summary.json"'))
    done = CliRunner().invoke(main, ["solve", str(scene), "--output", str(folder / "plain"), "--quiet"])
    assert done.exit_code == 0, done.output
    assert json.loads((folder / "plain" / "summary.json").read_text())["work"]["unknowns"] > 0
    if find_spec("pyvista") is None:
        scene.write_text(SCENE.replace("FILES", '"solution.vtp"'))
        refused = CliRunner().invoke(main, ["solve", str(scene), "--output", str(folder / "mesh")])
        assert refused.exit_code == 1, refused.output
        assert "[view]" in refused.output, refused.output
        assert not (folder / "mesh").exists()


def from_readme() -> None:
    """Run the README's scene, as far as a picture is asked for: that needs an extra, which is named."""
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)
    before, _, picture = code.rpartition("solution.picture(")
    names: dict[str, object] = {}
    exec(before, names)
    if find_spec("pyvista") is None:
        refused = ""
        try:
            exec("solution.picture(" + picture, names)
        except MissingDependencyError as error:
            refused = str(error)
        assert "[view]" in refused, refused


if __name__ == "__main__":
    from_python()
    from_readme()
    with tempfile.TemporaryDirectory() as folder:
        from_file(Path(folder))
