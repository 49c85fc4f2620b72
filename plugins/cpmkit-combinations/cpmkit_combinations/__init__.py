"""Sources made of other sources of any kind: unions, moved, solids, tubes, trimmed parts, and cuts traced as cubics."""

from cpmkit_combinations import plugin

__all__ = ["plugin"]
