"""Layouts and tables of a scene, asked for as `cpmkit.solve` is: by a spacing and keyword arguments."""

from cpmkit.forms import choice
from cpmkit.forms.collocation import band_layout, discretization


def lay_out(scene, spacing, **options):
    return band_layout.lay_out(scene, choice.options_of(scene, spacing, {**options, "form": "collocation"})[0])


def build_tables(scene, spacing, **options):
    return discretization.build_tables(scene, choice.options_of(scene, spacing, {**options, "form": "collocation"})[0])
