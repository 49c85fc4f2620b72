"""Geometry that the spacing does not resolve: boundaries that meet, tips, rims that face each other, junctions."""
