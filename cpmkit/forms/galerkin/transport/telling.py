"""Layers at outflow that the spacing does not resolve, as a sentence."""

from __future__ import annotations

from collections.abc import Iterator

from cpmkit.errors import place
from cpmkit.forms.galerkin.conditions.terms import ConditionTerms
from cpmkit.scene.laws import Value

#: A layer is a / v . b wide; one of less than this share of the spacing is told.
LAYER_SPACINGS = 0.25


def of_layers(terms: ConditionTerms) -> Iterator[str]:
    """Say where a velocity leaves through a value that u can meet in a layer only that is thinner than the spacing."""
    if terms.speed_out is None:
        return
    spacing = terms.lattice.spacing
    for one in terms.held:
        if not isinstance(one.law, Value) or not len(one.rows):
            continue
        cell_numbers = terms.speed_out[one.rows] * spacing / terms.a[one.rows]
        worst = int(cell_numbers.argmax())
        if cell_numbers[worst] * LAYER_SPACINGS <= 1:
            continue
        where = place(terms.lattice.to_scene(terms.samples.points[one.rows[[worst]]])[0])
        width = spacing / cell_numbers[worst]
        yield (
            f"{one.what[0].upper()}{one.what[1:]}: the velocity flows out through a value that is given, near {where}; "
            f"where what arrives differs from it u has a layer {width:.2g} wide, which spacing={spacing:g} leaves out; "
            f"use {width / LAYER_SPACINGS:.2g} or less to see it."
        )
