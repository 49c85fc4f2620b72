"""Level sets phi = 0 given by a formula, by functions or by values on a grid."""

from cpmkit_levelset import plugin
from cpmkit_levelset.factories import decotetrahedron, dziuk, expression, function, goursat, grid, tooth

__all__ = ["decotetrahedron", "dziuk", "expression", "function", "goursat", "grid", "plugin", "tooth"]
