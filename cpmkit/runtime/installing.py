"""How what is not installed is added, in words that hold in a clone of the repository and out of one."""

from __future__ import annotations

#: Families of kinds that the project's own plugins bring. Each is an extra of the core, and a distribution.
FAMILIES = ("analytic", "fem", "levelset", "mesh", "parametric", "pointcloud", "svg")


def to_install(extra: str) -> str:
    """Return the command that adds an extra of cpmkit, and its like in a clone.

    >>> to_install("view")
    "`pip install 'cpmkit[view]'` (in a clone `pip install '.[view]'`)"
    >>> to_install("mesh")
    "`pip install 'cpmkit[mesh]'` (in a clone `pip install . ./plugins/cpmkit-mesh`)"
    """
    in_a_clone = f". ./plugins/cpmkit-{extra}" if extra in FAMILIES else f"'.[{extra}]'"
    if extra == "all":
        in_a_clone = "'.[view,data]' ./plugins/*"
    return f"`pip install 'cpmkit[{extra}]'` (in a clone `pip install {in_a_clone}`)"
