"""The matrices of linear elements: scikit-fem integrates, SciPy's sparse arrays come out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.plugin import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def stiffness_and_mass(
    vertices: Floats, faces: Ints, diffusivity: Floats | None = None, density: Floats | None = None
) -> tuple[csr_array, csr_array]:
    """Return the integrals of a grad u . grad v and of c u v over a triangulated surface.

    Without a and c the first is the cotangent Laplacian (Pinkall and Polthier 1993; Dziuk 1988), positive
    semi-definite, and the second the consistent mass matrix.

    Parameters
    ----------
    vertices : (v, d) float64
        d = 2 or 3.
    faces : (m, 3) int64
        Triangles with an area above zero.
    diffusivity, density : (v,) float64, optional
        a and c at the vertices, linear in between; 1 unless given.

    Returns
    -------
    stiffness, mass : csr_array (v, v)
    """
    from scipy.sparse import csr_array
    from skfem import Basis, BilinearForm, ElementTriP1, MeshTri
    from skfem.helpers import dot, grad

    from cpmkit_fem.surface_mapping import SurfaceMapping

    def gradients(u: Any, v: Any, given: Any) -> Any:
        return dot(grad(u), grad(v)) * given.weight

    def products(u: Any, v: Any, given: Any) -> Any:
        return u * v * given.weight

    mesh = MeshTri(np.ascontiguousarray(vertices.T), np.ascontiguousarray(faces.T))
    mapping, matrices = SurfaceMapping(mesh.p, mesh.t), []
    for form, weight in ((gradients, diffusivity), (products, density)):
        basis = Basis(mesh, ElementTriP1(), mapping=mapping, intorder=2 if weight is None else 3)
        at_points: Any = 1.0 if weight is None else basis.interpolate(weight)
        matrices.append(csr_array(BilinearForm(form).assemble(basis, weight=at_points)))
    return matrices[0], matrices[1]


def lumped(mass: csr_array) -> csr_array:
    """Return the diagonal matrix of the row sums of a mass matrix."""
    from scipy.sparse import diags_array

    return diags_array(np.asarray(mass.sum(axis=1)).ravel()).tocsr()
