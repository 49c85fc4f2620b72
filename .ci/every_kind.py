"""Every kind that the repository's plugins declare is installed from their wheels, with its module."""

from __future__ import annotations

import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

ROOT = Path(__file__).parents[1]
GROUP = "cpmkit.kinds"

declared = {
    kind
    for project in (ROOT / "plugins").glob("*/pyproject.toml")
    for kind in tomllib.loads(project.read_text(encoding="utf-8"))["project"]["entry-points"][GROUP]
}
installed = {point.name: point for point in entry_points(group=GROUP)}
assert set(installed) == declared, set(installed) ^ declared
for point in installed.values():
    file = Path(point.load().__file__)
    assert "site-packages" in file.parts, f"{point.value} comes from {file}, not from a wheel"
sys.stdout.write(f"{len(installed)} kinds from wheels\n")
