"""Formulas in t, or in u and v, with their derivatives; and constant formulas, such as ``2*pi``."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, FormulaJets, formula_jets, formula_tree

#: Value (n, d), first derivatives (n, m, d) and second derivatives (n, m, m, d).
Jet = tuple[Floats, Floats, Floats]


@dataclass(frozen=True, eq=False)
class FormulaMap:
    """A map written as formulas.

    Attributes
    ----------
    dim, count : int
        Number of coordinates and of parameters.
    jets : FormulaJets
        The coordinates in the parameters, with their derivatives.
    """

    dim: int
    count: int
    jets: FormulaJets

    def value(self, t: Floats, /) -> Floats:
        """Return the points (n, d) at parameters (n, m)."""
        return np.ascontiguousarray(self.jets.rows(0, t.T).T)

    def jet(self, t: Floats, /) -> Jet:
        """Return points (n, d), derivatives (n, m, d) and second derivatives (n, m, m, d) at ``t`` (n, m)."""
        from cpmkit_parametric import unit_kernels

        p, J, H = unit_kernels.unpack_jets(self.jets.rows(2, t.T), self.count, self.dim)
        return p, J, H


def formula_map(x: Sequence[ast.expr], names: Sequence[str]) -> FormulaMap:
    """Return the map of the formulas ``x``, d checked syntax trees in the parameters ``names``.

    Raise SceneError if they are too long together.
    """
    return FormulaMap(len(x), len(names), formula_jets(x, names, "x"))


def symmetric_derivatives(upper: Floats, count: int) -> Floats:
    """Return (n, m, m, d) from the upper triangle (n, m (m + 1) / 2, d), row by row; ``count`` is m, 1 or 2."""
    place = {1: [[0]], 2: [[0, 1], [1, 2]]}[count]
    return np.ascontiguousarray(upper[:, place])


def evaluate_constant(text: str, label: str) -> float:
    """Return the value of a formula without variables; infinite or NaN where it has none.

    Raise SceneError if it does not parse, or uses what is not offered; ``label`` names it.
    """
    jets = formula_jets([formula_tree(text, (), label)], (), label)
    return float(jets.rows(0, np.empty((0, 1)))[0, 0])
