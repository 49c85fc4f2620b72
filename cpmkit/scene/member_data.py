"""Data with a value, or a function, for each member of a union."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import InputError, place, shown
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.meetings import is_near
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.data import as_data, evaluate_data, reaction_rates, takes_time
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class MemberData:
    """A function of points that has a value, a formula or a function of points for each member of a union.

    Parameters
    ----------
    source : ClosestPointSource
        The union.
    values : sequence
        A number, a formula or a function of points for each member, in their order.

    Raises
    ------
    InputError
        If there is not one value for each member, or a formula does not parse.

    Examples
    --------
    >>> import cpmkit as ck
    >>> parts = [ck.source("analytic.circle"), ck.source("analytic.segment", start=[1, 0], end=[3, 0])]
    >>> both = ck.source("union", members=parts)
    >>> ck.MemberData(both, [1.0, "10*x"])([[0, 1], [2, 0]])
    array([ 1., 20.])
    """

    source: ClosestPointSource
    values: Sequence[Any]

    def __post_init__(self) -> None:
        """Read formulas; raise InputError if there is not one value for each member."""
        count = len(members_of(self.source))
        if not isinstance(self.values, Sequence) or len(self.values) != count:
            raise InputError(
                f"values must be a list with one entry for each of {count} members, got {shown(self.values)}."
            )
        entries = [as_data(value, f"data of member {k}") for k, value in enumerate(self.values)]
        object.__setattr__(self, "values", entries)

    @property
    def takes_time(self) -> bool:
        """True if the data of a member depend on the time."""
        return takes_time(list(self.values))

    def __call__(self, points: Floats, t: float | None = None) -> Floats:
        """Return the data (n,) or (n, channels) at ``points`` (n, d): those of the member with the closest point.

        Raises InputError if several points lie in members of two dimensions whose data differ there, so that rounding
        would decide.
        """
        points = as_points(points, self.source.dim)
        number = self.member_at(points)
        found = self._values_of(number, points, t)
        self._check_one_value(points, number, found.reshape(len(points), -1), t)
        return found

    def nearest_values(self, points: Floats, t: float | None = None) -> Floats:
        """Return the data (n,) or (n, channels) of the member with the closest point to each of ``points`` (n, d)."""
        return self._values_of(self.member_at(points), points, t)

    def _values_of(self, number: Ints, points: Floats, t: float | None) -> Floats:
        """Return the data (n,) or (n, channels) of the members ``number`` (n,) at ``points`` (n, d)."""
        columns = [
            evaluate_data(value, points[number == k], None, f"data of member {k}", t)
            for k, value in enumerate(self.values)
        ]
        found = np.empty((len(points), max(each.shape[1] for each in columns)))
        for k, each in enumerate(columns):
            found[number == k] = each
        return found if found.shape[1] > 1 else found[:, 0]

    def _check_one_value(self, points: Floats, number: Ints, found: Floats, t: float | None) -> None:
        """Raise InputError if several ``points`` lie in a member of another dimension too whose data differ."""
        members = members_of(self.source)
        dims = np.array([largest_dim(member) for member in members])
        for k, value in enumerate(self.values if len({*dims}) > 1 else ()):
            rows = np.flatnonzero(dims[number] != dims[k])
            rows = rows[is_near(members[k], points[rows], self.source)]
            differ = (evaluate_data(value, points[rows], None, f"data of member {k}", t) != found[rows]).any(axis=1)
            if differ.sum() > 1:  # one point is evaluated to count channels
                row = rows[differ.argmax()]
                raise InputError(
                    f"points such as {place(points[row])} lie in the members {number[row]} and {k} of the union, and "
                    "data by member differ there; pass them themselves in place of a function that calls them, and "
                    "in `integrate` write the value of the member."
                )

    def member_at(self, points: Floats) -> Ints:
        """Return the number (n,) of the member with the closest point to each of ``points`` (n, d)."""
        element = self.source.closest_point(np.ascontiguousarray(points, dtype=np.float64)).element
        return np.zeros(len(points), dtype=np.int64) if element is None else element

    def of_members(self, numbers: Sequence[int], source: ClosestPointSource) -> Any:
        """Return the data of the members with these ``numbers``; ``source`` is the union of these members."""
        chosen = [self.values[number] for number in numbers]
        return chosen[0] if len(chosen) == 1 else MemberData(source, chosen)


@dataclass(frozen=True)
class ReactionAt:
    """A reaction at a time, as a function of values and points; :class:`MemberData` give one for each member."""

    reaction: Any  #: A function of values (p, channels), and perhaps points (p, d) and t, or one for each member.
    time: float
    start: float  #: The time of the initial data.

    def __call__(self, u: Floats, points: Floats) -> Floats:
        """Return the rates (p, channels) for values u (p, channels) at ``points``, as :func:`reaction_rates` does."""
        if not isinstance(self.reaction, MemberData):
            return reaction_rates(self.reaction, u, points, self.time, self.start)
        number, rates = self.reaction.member_at(points), np.empty_like(u)
        for k, own in enumerate(self.reaction.values):
            rows = number == k
            rates[rows] = reaction_rates(own, u[rows], points[rows], self.time, self.start)
        return rates
