"""The matrices of linear elements: scikit-fem integrates, SciPy's sparse arrays come out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.plugin import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def stiffness_and_mass(vertices: Floats, faces: Ints) -> tuple[csr_array, csr_array]:
    """Return the integrals of grad u . grad v and of u v over a triangulated surface.

    The first is the cotangent Laplacian (Pinkall and Polthier 1993; Dziuk 1988), positive
    semi-definite; the second is the consistent mass matrix.

    Parameters
    ----------
    vertices : (v, d) float64
        d = 2 or 3.
    faces : (m, 3) int64
        Triangles with an area above zero.

    Returns
    -------
    stiffness, mass : csr_array (v, v)
    """
    from scipy.sparse import csr_array
    from skfem import Basis, BilinearForm, ElementTriP1, MeshTri
    from skfem.helpers import dot, grad

    from cpmkit_fem.surface_mapping import SurfaceMapping

    def gradients(u: Any, v: Any, _: Any) -> Any:
        return dot(grad(u), grad(v))

    def products(u: Any, v: Any, _: Any) -> Any:
        return u * v

    mesh = MeshTri(np.ascontiguousarray(vertices.T), np.ascontiguousarray(faces.T))
    basis = Basis(mesh, ElementTriP1(), mapping=SurfaceMapping(mesh.p, mesh.t), intorder=2)
    stiffness, mass = (csr_array(BilinearForm(form).assemble(basis)) for form in (gradients, products))
    return stiffness, mass
