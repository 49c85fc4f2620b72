"""What holds on boundaries and rims, as terms of the Galerkin form's energy and loads.

Boundary samples lie on facets of cells, one set for each cell beside a facet, so that each side of a boundary is read
from its own cells: which side that is, the cells tell, and the scene names it.
"""
