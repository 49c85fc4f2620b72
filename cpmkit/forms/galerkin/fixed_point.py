"""The units of the numbers of fixed point in which samples are held."""

from __future__ import annotations

#: What one unit of a place is in spacings, and one of a normal's component: 1 and -1 are whole numbers of it.
PLACE_UNIT, NORMAL_UNIT = 2.0**-32, 2.0**-30
