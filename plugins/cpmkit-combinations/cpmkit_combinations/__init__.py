"""Sources made of other sources, whatever their kind: unions, moved sources, solids, tubes, cuts and trimmed parts."""

from cpmkit_combinations import plugin

__all__ = ["plugin"]
