"""What each combination makes of each optional ability of what it combines: one table."""

from __future__ import annotations

from collections.abc import Mapping

from cpmkit.combinations import motion, solid, trimmed_part, union
from cpmkit.manifold.abilities import Passing

#: By kind, then by protocol: the class that passes the ability on, True where the combination has it in any case, or
#: the reason why it has not.
TABLE: Mapping[str, Passing] = {
    "moved": motion.PASSING,
    "union": union.PASSING,
    "trimmed": trimmed_part.PASSING,
    "solid": solid.PASSING,
}
