"""The scene that ``cpmkit new`` writes: small enough to run in seconds, with every table that a scene begins with."""

from __future__ import annotations

from pathlib import Path

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name, check_place, written_whole

FIRST_SCENE = """\
# A first scene of cpmkit: heat that spreads on a torus between two circles.
#
#   cpmkit explain {file}
#   cpmkit solve {file}
#
# `cpmkit plugins` lists the kinds of surfaces and curves, `cpmkit plugins analytic.torus` the keys of one.

[surface]
kind = "analytic.torus"
major = 1.0                 # from the centre to the middle of the tube
minor = 0.4                 # radius of the tube

[[boundary]]
name = "outside"            # the longest circle around the torus
kind = "analytic.circle"
normal = [0, 0, 1]
radius = 1.4
left = {{ dirichlet = 1.0 }}  # at your left hand when you walk along the circle
right = {{ dirichlet = "x" }} # a formula in x, y, z

[problem]
kind = "laplace"            # -Lap u = 0; others: poisson, heat, eigen, ...

[discretization]
spacing = 0.1               # of the lattice: half of it costs four times as much

[output]
folder = "{stem}"
files = ["solution.vtp", "summary.json"]
# picture = {{ file = "picture.png", isolines = 8 }} # with `pip install 'cpmkit[pictures]'`
"""


def write_first_scene(name: str) -> Path:
    """Write the scene into ``name``, to which ``.toml`` is added where it has no ending, and return the file.

    Raises
    ------
    InputError
        If the file is there already, has another ending, or cannot be written.
    """
    file = Path(name) if Path(name).suffix else Path(f"{name}.toml")
    if file.suffix != ".toml" or not file.stem.strip("."):
        raise InputError(f"a scene must be a .toml file, got {shown(name)}.")
    if not file.stem.isprintable() or any(letter in file.stem for letter in "\"\\'"):
        raise InputError(f"the name of a scene must be without quotes and backslashes, got {shown(name)}.")
    check_name(file)
    if file.exists():
        raise InputError(f"{shown(str(file))} is there already; give another name, or remove it.")
    check_place(file)
    with written_whole(file) as part:
        part.write_text(FIRST_SCENE.format(file=file, stem=file.stem), encoding="utf-8")
    return file
