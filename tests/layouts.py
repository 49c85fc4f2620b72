"""Layouts and tables of a scene, asked for as `cpmkit.solve` is: by a spacing and keyword arguments."""

from cpmkit.forms import choice
from cpmkit.forms.collocation import band_layout, discretization


def build_layout(scene, spacing, **options):
    return band_layout.build_layout(scene, choice.options_of(scene, spacing, {**options, "form": "collocation"})[0])


def build_tables(scene, spacing, **options):
    return discretization.build_tables(scene, choice.options_of(scene, spacing, {**options, "form": "collocation"})[0])
