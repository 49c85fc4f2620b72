"""Matrices and loads of an equation on a union: those of its parts, and the terms of the junctions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any, Self

import numpy as np

from cpmkit.forms.form_records import StateDependentCoefficient, StateFlux
from cpmkit.forms.galerkin.advection import join_advections
from cpmkit.forms.galerkin.equation_assembly import GalerkinOperator, free_constants_of
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.space.energy import scalar_coefficient
from cpmkit.forms.galerkin.unions.junctions import (
    Contact,
    DiscContact,
    advection_blocks,
    contact_blocks,
    disc_contact_blocks,
)
from cpmkit.forms.galerkin.unions.part_scenes import restrict_fields
from cpmkit.forms.galerkin.unions.union_parts import PartFlux, UnionPart
from cpmkit.forms.options import Options
from cpmkit.linear.multigrid.solver import Level
from cpmkit.linear.operators import Border, CsrOperator, Operator, without_border
from cpmkit.scene.data import Data, Functional
from cpmkit.scene.equations import Terms
from cpmkit.scene.member_data import ReactionAt
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, SparseMatrix


@dataclass(frozen=True, eq=False)
class UnionOperator(GalerkinOperator):
    """The operator of a union, with those of its parts."""

    parts: tuple[GalerkinOperator, ...] = ()


@dataclass(frozen=True, eq=False)
class UnionAssembly:
    """The part of the form of a union that assembles the equation of a scene."""

    scene: Scene
    options: Options[GalerkinOptions]  #: The options of the discretisation.
    parts: tuple[UnionPart, ...]  #: The members of each dimension, ascending.
    #: The samples at which parts touch, by the numbers of the part of higher dimension and that of lower dimension.
    contacts: Mapping[tuple[int, int], Contact] = field(repr=False)
    #: The points at which curves meet surfaces, or that they have in solids, by the same numbers.
    disc_contacts: Mapping[tuple[int, int], DiscContact] = field(repr=False)

    @property
    def forms(self) -> list[Galerkin]:
        """The forms of the parts."""
        return [part.form for part in self.parts]

    @property
    def spacing(self) -> float:
        """Spacing of the lattice, in the scene's unit."""
        return self.options.spacing

    @property
    def constant(self) -> Floats:
        """(n, 1) the unknowns of the function 1."""
        return np.concatenate([form.constant for form in self.forms])

    @cached_property
    def mass(self) -> CsrOperator:
        """M, the sum over the parts of the integrals of products of functions."""
        return CsrOperator(_block_diagonal([form.mass.matrix for form in self.forms]), symmetric=True)

    @cached_property
    def mass_in_time(self) -> CsrOperator:
        """M + h^2 S with the upwinding of du/dt; S is the stabilisation."""
        masses = [form.mass_in_time for form in self.forms]
        return CsrOperator(_block_diagonal([mass.matrix for mass in masses]), all(mass.symmetric for mass in masses))

    def weighted_mass(self, values: Floats) -> SparseMatrix:
        """Return the integrals (n, n) of c u v, with the ``values`` (p,) of c at the samples."""
        return _block_diagonal([part.form.weighted_mass(values[part.points]) for part in self.parts])

    def stiffness(self, terms: Terms) -> UnionOperator:
        """Return A: the operators of the parts and the terms of the junctions; raises the errors of the parts."""
        operators = [part.form.stiffness(self._terms_of(part, terms)) for part in self.parts]
        blocks: list[list[Any]] = [[None] * len(self.parts) for _ in self.parts]
        for k, operator in enumerate(operators):
            blocks[k][k] = operator.matrix
        for (high, low), contact in self.contacts.items():
            conditions = operators[high].conditions
            assert conditions is not None
            _add_symmetric_blocks(blocks, high, low, contact_blocks(conditions, contact))
            if terms.velocity is not None:
                _add_blocks(blocks, high, low, advection_blocks(conditions, contact, terms.conservative))
        for (high, low), at_points in self.disc_contacts.items():
            part = self.parts[high]
            a = part.form.coefficients.diffusivity(self._terms_of(part, terms).diffusivity)
            a = scalar_coefficient(part.form.space.splines, a)
            at = np.broadcast_to(a[:1], len(at_points.nearest)) if len(a) == 1 else a[at_points.nearest]
            of_curves = operators[low].conditions
            assert of_curves is not None
            _add_blocks(blocks, high, low, disc_contact_blocks(at_points, at, of_curves, terms.conservative))
        return UnionOperator(
            _stack_blocks(blocks),
            all(each.symmetric for each in operators),
            any(each.indefinite for each in operators),
            fixed=all(each.fixed for each in operators),
            waves=max(each.waves for each in operators),
            least=min(each.least for each in operators),
            lowest=min(each.lowest for each in operators),
            symmetric_pattern=all(each.symmetric_pattern for each in operators),
            advection=join_advections([each.advection for each in operators]),
            parts=tuple(operators),
        )

    def free_constants(self, stiffness: Any) -> Border | None:
        """Return the pieces of the union where constants solve A u = 0, and means over them; None if there are none.

        Raises SceneError if a conservative velocity leaves another function undetermined.
        """
        return free_constants_of(stiffness, lambda: self.mass, self.mass.size)

    def _terms_of(self, part: UnionPart, terms: Terms) -> Terms:
        """Return the ``terms`` of an equation on the union for a part."""
        made: Terms = restrict_fields(terms, lambda data: part.restrict(data, self))
        return made

    def advection(self, field: StateDependentCoefficient) -> CsrOperator:
        """Return the matrix (n, n) of the integrals of u (w . grad v), w the ``field``, on each part."""
        matrices = [part.form.advection(part.restrict(field, self)).matrix for part in self.parts]
        return CsrOperator(_block_diagonal(matrices))

    def boundary_mass(self, stiffness: Any) -> CsrOperator | None:
        """Return the integrals (n, n) of a u v where du/db = lambda u; None if that is nowhere."""
        masses = [form.boundary_mass(own) for form, own in zip(self.forms, stiffness.parts, strict=True)]
        if all(mass is None for mass in masses):
            return None
        from scipy.sparse import csr_array

        sizes = [(form.size, form.size) for form in self.forms]
        blocks = [csr_array(size) if mass is None else mass.matrix for mass, size in zip(masses, sizes, strict=True)]
        return CsrOperator(_block_diagonal(blocks), symmetric=True)

    def levels(self, operator: Operator) -> Sequence[Level]:
        """Return multigrid levels of ``operator``: those of the parts side by side, as long as a part has any."""
        from scipy.sparse import eye_array

        inner = without_border(operator)
        found = []
        sizes = [form.size for form in self.forms]
        touched = [self._touched_unknowns(number) for number in range(len(self.parts))]
        for levels in zip_longest(*(form.space.plain_levels for form in self.forms)):
            blocks, strips, start = [], [], 0
            for k, level in enumerate(levels):
                blocks.append(eye_array(sizes[k], format="csr") if level is None else level.prolongation)
                own = np.arange(sizes[k]) if level is None else np.union1d(level.strip, touched[k])
                strips.append(start + own)
                start += sizes[k]
                touched[k] = np.unique(blocks[-1][touched[k]].indices)
                sizes[k] = blocks[-1].shape[1]
            in_blocks = any(level is not None and level.in_blocks for level in levels)
            found.append(Level(_block_diagonal(blocks), np.concatenate(strips), in_blocks=in_blocks))
        return inner.usable_levels(found, self.spacing) if isinstance(inner, GalerkinOperator) else found

    def _touched_unknowns(self, number: int) -> Ints:
        """Return the unknowns of part ``number``, if it is a curve, that are coupled to parts of higher dimension."""
        if self.parts[number].dim > 1:
            return np.zeros(0, dtype=np.int64)
        rows = [contact.lower for (_, low), contact in self.contacts.items() if low == number]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(each.indices for each in rows)]))

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals (n, channels) of ``f`` at ``time`` times each function."""
        if isinstance(f, Functional):
            return f.loads(self, time)
        return np.concatenate([part.form.load(part.restrict(f, self), time) for part in self.parts])

    def reaction_load(self, function: Callable[[Floats, Floats], Floats], u: Floats) -> Floats:
        """Return the load (n, channels) of ``function(values, points)`` at the values of ``u`` (n, channels)."""
        loads = []
        for part in self.parts:
            own = function
            if isinstance(function, ReactionAt):
                own = replace(function, reaction=part.restrict(function.reaction, self))
            loads.append(part.form.reaction_load(own, u[part.unknowns]))
        return np.concatenate(loads)

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n,) of vectors (p, d) at the samples times the tangential gradient of each function."""
        return np.concatenate([part.form.gradient_load(values[part.points]) for part in self.parts])

    def condition_load(self, stiffness: Any, time: float | None = None, of: str = "value") -> Floats:
        """Return the load (n, channels) of the conditions' data at ``time``."""
        loads = [form.condition_load(own, time, of) for form, own in zip(self.forms, stiffness.parts, strict=True)]
        return np.concatenate(loads)

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """The samples on boundaries at which the flux of a condition depends on u, for each such condition."""
        return [PartFlux(flux, part.unknowns) for part in self.parts for flux in part.form.state_fluxes]

    def linearise(self, seen: Sequence[Floats]) -> Self:
        """Return the form with each flux of :attr:`state_fluxes` linearised at its values (k,) of u in ``seen``."""
        parts, rest = [], [*seen]
        for part in self.parts:
            count = len(part.form.state_fluxes)
            parts.append(replace(part, form=part.form.linearise(rest[:count])))
            rest = rest[count:]
        return replace(self, parts=tuple(parts))


def _block_diagonal(matrices: Sequence[Any]) -> Any:
    """Return the sparse matrix with the ``matrices`` on its diagonal."""
    from scipy.sparse import block_diag

    return block_diag(matrices, format="csr")


def _add_symmetric_blocks(blocks: list[list[Any]], high: int, low: int, added: Sequence[Any]) -> None:
    """Add the blocks (n, n), (n, m) and (m, m) of a junction of the parts ``high`` and ``low`` to ``blocks``."""
    upper, across, lower = added
    _add_blocks(blocks, high, low, (upper, across, across.T, lower))


def _add_blocks(blocks: list[list[Any]], high: int, low: int, added: Sequence[Any]) -> None:
    """Add blocks (n, n), (n, m), (m, n), (m, m) of a junction of the parts ``high`` and ``low`` to ``blocks``."""
    places = (high, high), (high, low), (low, high), (low, low)
    for (row, column), block in zip(places, added, strict=True):
        before = blocks[row][column]
        blocks[row][column] = block if before is None else before + block


def _stack_blocks(blocks: list[list[Any]]) -> Any:
    """Return the sparse matrix of ``blocks`` by row and column, None for zero, with ascending columns."""
    from scipy.sparse import block_array

    matrix = block_array(blocks, format="csr")
    matrix.sort_indices()
    return matrix
