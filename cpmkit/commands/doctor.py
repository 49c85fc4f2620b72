"""Diagnosis of an installation: versions, kinds and the machine, to be sent along with a question."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cpmkit.errors import CpmkitError
from cpmkit.plugins import installed_kinds
from cpmkit.runtime.compilation import processors
from cpmkit.runtime.memory import memory_limit
from cpmkit.runtime.messages import collected_warnings, install_command
from cpmkit.solution.summary import version_of

#: Distributions whose versions matter, the required ones first.
DISTRIBUTIONS = (
    *("cpmkit", "numpy", "scipy", "numba", "pluggy", "click"),
    *("trimesh", "scikit-fem", "pyvista", "matplotlib", "imageio"),
)


@dataclass(frozen=True)
class Diagnosis:
    """The versions and kinds that are installed, the machine, and whether a scene loads."""

    system: str  #: Python and the operating system.
    #: Version of each distribution that matters; ``None`` where it is not installed.
    versions: Mapping[str, str | None]
    kinds: Mapping[str, str]  #: Installed kinds and the distribution of each, with its version.
    processors: int  #: Processors that this process may use.
    memory: str  #: The memory that this process may use, and the origin of the limit, in words.
    variables: Mapping[str, str]  #: Environment variables that are set and change what cpmkit does.
    scene: str | None  #: The error that loading the scene raises, empty if it loads; ``None`` if no scene was given.
    advice: tuple[str, ...]  #: Sentences: warnings of the scene, and missing plugins and libraries.

    def __str__(self) -> str:
        """Return the diagnosis as lines of names and values, with the advice below."""
        rows = [("system", self.system), ("processors", str(self.processors)), ("memory", self.memory)]
        rows += [(name, found or "not installed") for name, found in self.versions.items()]
        rows += [(name, value) for name, value in self.variables.items()]
        rows += [("kinds", ""), *((f"  {kind}", distribution) for kind, distribution in self.kinds.items())]
        if self.scene is not None:
            rows.append(("scene", self.scene or "loads"))
        width = max(len(name) for name, _ in rows) + 2
        lines = [f"{name:<{width}}{value}".rstrip() for name, value in rows]
        return "\n".join([*lines, *(f"\n{sentence}" for sentence in self.advice)])


def diagnose(scene: str | Path | None = None) -> Diagnosis:
    """Return what is installed, what the machine offers, and whether a scene file loads.

    Plugins are listed without being imported, but for those that ``scene`` names; an error of the scene is not raised.
    """
    versions = {name: version_of(name) for name in DISTRIBUTIONS}
    variables = ("CPMKIT_DATA", "CPMKIT_CACHE", "CPMKIT_FETCH", "CPMKIT_THREADS")
    kinds = {kind.kind: f"{kind.distribution} {kind.version}" for kind in installed_kinds()}
    problem = None
    with collected_warnings() as heard:
        if scene is not None:
            from cpmkit.scenefile.scene_files import load_scene

            try:
                load_scene(scene)
                problem = ""
            except CpmkitError as error:
                problem = str(error)
    advice = list(heard)
    if not kinds:
        advice.append(f"No plugin is installed, so no scene can name a shape: {install_command('all')} adds them.")
    needed = {"Pictures": "matplotlib", ".vtp files": "pyvista", ".mp4 films": "imageio"}
    missing = [purpose for purpose, library in needed.items() if versions[library] is None]
    if missing:
        advice.append(f"{' and '.join(missing)} need more than is installed: {install_command('view')} adds it.")
    return Diagnosis(
        system=f"Python {platform.python_version()}, {platform.platform()}",
        versions=versions,
        kinds=kinds,
        processors=processors(),
        memory=str(memory_limit()),
        variables={name: os.environ[name] for name in variables if name in os.environ},
        scene=problem,
        advice=tuple(advice),
    )
