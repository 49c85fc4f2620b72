"""Sums, norms and ranges over groups of rows, all groups at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Groups:
    """Rows (n, ...) in groups, each of one row or more.

    Attributes
    ----------
    label : (n,) int64
        The group of each row, (1,) where there is one group.
    order : (n,) int64
        The rows, group by group; a slice of all where there is one group.
    starts : (groups,) int64
        Where each group begins in that order.
    """

    label: Ints
    order: Any
    starts: Ints

    @classmethod
    def of(cls, count: int, label: Ints) -> Groups:
        """Return ``count`` groups by the label of each row."""
        if count == 1:
            return cls(np.zeros(1, dtype=np.int64), slice(None), np.zeros(1, dtype=np.int64))
        order = np.argsort(label, kind="stable")
        members = np.bincount(label, minlength=count)
        return cls(label, order, np.cumsum(members) - members)

    def at(self, values: Any) -> Any:
        """Return of ``values`` (groups, ...) each row's, (n, ...), or (1, ...) where there is one group."""
        return values if len(self.starts) == 1 else values[self.label]

    def sums(self, rows: Any) -> Any:
        """Return the sums (groups, ...) of ``rows`` (n, ...)."""
        return self._reduced(np.add, rows)

    def products(self, left: Any, right: Any) -> Any:
        """Return the sums (groups, k, m) of products of columns of ``left`` (n, k) and ``right`` (n, m)."""
        if len(self.starts) == 1:
            return (left.T @ right)[None]
        return self.sums(left[:, :, None] * right[:, None])

    def norms(self, rows: Any) -> Floats:
        """Return the norms (groups, m) of the columns of ``rows`` (n, m)."""
        return np.asarray(np.sqrt(self.sums(np.abs(rows) ** 2)))

    def largest(self, rows: Any) -> Floats:
        """Return the largest absolute values (groups, m) in the columns of ``rows`` (n, m)."""
        return np.asarray(self._reduced(np.maximum, np.abs(rows)))

    def ranges(self, rows: Floats) -> Floats:
        """Return the ranges (groups, m) of the columns of ``rows`` (n, m)."""
        return np.asarray(self._reduced(np.maximum, rows) - self._reduced(np.minimum, rows))

    def _reduced(self, operation: np.ufunc, rows: Any) -> Any:
        return operation.reduceat(rows[self.order], self.starts, axis=0)
