"""The laws that solutions are held to, and the verdicts: right, warned of, refused, or wrong.

exact : the solution is the smooth u that the data were made of.
constant : so it is where u is constant.
pair : two scenes that stand for the same (moved, another origin, another representation) have the same solution.
shift : u + 1000 solves what u solves, with data 1000 larger.
superposition : data that are a sum have the sum of the solutions.
reciprocity : the integral of g u_f is that of f u_g.
total : with nothing flowing in or out the integral of u stays.
maximum : a solution without a source is nowhere beyond its boundary data.
eigenvalues : they are those that are known, and not negative.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from extremes.ambient import Sum, Waves
from extremes.cases import STEP, STEPS, Case

import cpmkit as ck
from cpmkit.errors import CpmkitError

#: An error is wrong above so many times what the solution's estimate says.
FACTOR = 2.5
#: And above these shares of the range, root mean square and largest.
SMALL_RMS, SMALL_LARGEST = 3e-3, 1.5e-2
#: Where no estimate can be made, and the user is told so, errors are held to these.
UNESTIMATED_RMS, UNESTIMATED_LARGEST = 0.05, 0.2
#: What stopping early leaves of a relation that holds up to the solution of linear systems.
ALGEBRAIC = 2e-5
COUNT = 400


@dataclass(frozen=True)
class Verdict:
    """What came of a case.

    Attributes
    ----------
    outcome : str
        ``"right"``, ``"warned"`` (right or not, there is a warning), ``"refused"`` or ``"wrong"``.
    error, allowed : float
        The law's error, and what is allowed of it, the worse of both norms.
    sentences : tuple of str
        Warnings, or the refusal.
    """

    outcome: str
    error: float = 0.0
    allowed: float = 0.0
    sentences: tuple[str, ...] = ()

    @property
    def off(self) -> bool:
        """Whether the error is beyond what is allowed, said or not."""
        return not self.error <= self.allowed


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution with its estimates, as shares of its range, and what was said."""

    solution: Any
    rms: float
    largest: float
    unit: float
    sentences: tuple[str, ...]

    def at(self, case: Case, local: Any) -> Any:
        """Return values (n,) at local points, in the solution of the case."""
        return self.solution.evaluate(case.place.world(local)).reshape(len(local))


def answer(case: Case) -> Answer:
    """Solve a case and read its estimate."""
    options = dict(case.options)
    if case.origin is not None:
        options["origin"] = case.place.world([case.origin])[0]
    spacing = None if "tolerance" in options else case.spacing * case.place.scale
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        solution = ck.solve(case.scene(), spacing, **options)
        try:
            error = solution.error
        except CpmkitError:
            rms, largest, unit, slow = UNESTIMATED_RMS, UNESTIMATED_LARGEST, 0.0, ""
        else:
            unit, slow = float(error.unit.max()), error.slow
            floor = float(error.floor.max())
            rms, largest = FACTOR * (error.of("rms") + floor), FACTOR * (error.of("max") + floor)
    said = [str(one.message) for one in heard] + list(solution.warnings) + [slow]
    return Answer(solution, rms, largest, unit, tuple(dict.fromkeys(filter(None, said))))


def judge(case: Case) -> Verdict:
    """Return the verdict; what is no CpmkitError is a defect and comes through."""
    try:
        return LAWS[case.law](case)
    except CpmkitError as error:
        sentence = str(error)
        return Verdict("refused" if sentence.endswith(".") else "wrong", sentences=(sentence,))


def verdict(error: float, allowed: float, sentences: Any) -> Verdict:
    """Return the verdict of an error, which is NaN where a solution is."""
    if sentences:
        return Verdict("warned" if np.isfinite(error) else "wrong", error, allowed, tuple(sentences))
    return Verdict("right" if error <= allowed else "wrong", error, allowed)


def compared(off: Any, extent: float, answers: list[Answer]) -> Verdict:
    """Return the verdict of differences (n,) of solutions from each other or the truth."""
    rms, largest = float(np.sqrt(np.mean(off**2))) / extent, float(np.abs(off).max()) / extent
    allowed = max(sum(one.rms for one in answers), SMALL_RMS), max(sum(one.largest for one in answers), SMALL_LARGEST)
    sentences = [sentence for one in answers for sentence in one.sentences]
    worse = rms / allowed[0] >= largest / allowed[1] or not np.isfinite(rms)
    return verdict(*((rms, allowed[0]) if worse else (largest, allowed[1])), sentences)


def sampled(case: Case) -> Any:
    """Return local points, none on the first curve, where the reading has a side."""
    x = case.shape.points(COUNT, np.random.default_rng(7))
    if case.step:
        height = case.inside[0].at if case.shape.normal(x[:1])[0, 2] == 1 else case.shape.parallel(case.inside[0].at)[0]
        x = x[np.abs(x[:, 1 if case.shape.normal(x[:1])[0, 2] == 1 else 2] - height) > 1e-3]
    return x


def exact(case: Case) -> Verdict:
    """Hold the solution to u, up to a constant where nothing fixes one."""
    found, x = answer(case), sampled(case)
    u = case.exact(x, STEP * STEPS if case.equation in ("heat", "reaction") else None)
    off = found.at(case, x) - u
    if case.equation == "poisson" and case.shape.closed and not case.inside:
        off = off - off.mean()
    return compared(off, np.ptp(u) or np.abs(u).max(), [found])


def pair(case: Case) -> Verdict:
    """Hold two solutions of the same to each other."""
    second = replace(case, **case.other)
    first, other, x = answer(case), answer(second), sampled(case)
    values = first.at(case, x)
    return compared(other.at(second, x) - values, max(np.ptp(values), first.unit), [first, other])


def shift(case: Case) -> Verdict:
    """Hold u + 1000 to u."""
    lifted = replace(case, u=Sum(case.u, Waves((0.0,), ((0.0,) * case.shape.dim,), (0.0,), 1000.0)))
    first, other, x = answer(case), answer(lifted), sampled(case)
    values = first.at(case, x)
    return compared(other.at(lifted, x) - 1000.0 - values, np.ptp(values), [first, other])


def _second(case: Case) -> Case:
    """Return a case with another load."""
    if isinstance(case.u, Waves):
        return replace(case, u=replace(case.u, phases=tuple(1.3 + b for b in case.u.phases), shift=0.4))
    return replace(case, u=Waves((1.0,), ((1.0,) * case.shape.dim,), (0.4,), 0.4))


def superposition(case: Case) -> Verdict:
    """Hold the solution of f + g to the sum, where one lattice and one matrix serve all."""
    second = _second(case)
    both = replace(case, u=Sum(case.u, second.u))
    answers, x = [answer(one) for one in (case, second, both)], sampled(case)
    values = [one.at(case, x) for one in answers]
    off = values[2] - values[0] - values[1]
    sentences = [sentence for one in answers for sentence in one.sentences]
    return verdict(np.abs(off).max() / np.ptp(values[2]), 100 * ALGEBRAIC, sentences)


def reciprocity(case: Case) -> Verdict:
    """Hold the integral of g u_f to that of f u_g; conditions are homogeneous."""
    second = _second(case)
    first, other = answer(case), answer(second)
    one = first.solution.integrate(lambda x, u: u * second.u.value(case.local(x)))
    two = other.solution.integrate(lambda x, u: u * case.u.value(case.local(x)))
    size = first.solution.integrate(lambda x, u: np.abs(u * second.u.value(case.local(x))))
    return verdict(
        float(abs(one - two) / size), max(first.rms + other.rms, ALGEBRAIC), first.sentences + other.sentences
    )


def total(case: Case) -> Verdict:
    """Hold the heat at the end to that at the beginning."""
    found = answer(case)
    start = found.solution.integrate(lambda x, u: case.exact(case.local(x), 0.0))
    size = found.solution.integrate(lambda x, u: np.abs(case.exact(case.local(x), 0.0)))
    return verdict(float(abs(found.solution.integrate() - start) / size), max(found.rms, ALGEBRAIC), found.sentences)


def maximum(case: Case) -> Verdict:
    """Hold a solution of Laplace's equation to its data, which lie between -1 and 1."""
    found, x = answer(case), sampled(case)
    values = found.at(case, x)
    beyond = max(float(values.max()) - 1, -1 - float(values.min()), 0.0)
    if not np.isfinite(values).all():
        beyond = np.nan
    return verdict(beyond, max(found.largest * found.unit, SMALL_LARGEST), found.sentences)


def eigenvalues(case: Case) -> Verdict:
    """Hold eigenvalues to those that are known, in local coordinates."""
    known = np.array(case.terms["known"])
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        options = {} if case.origin is None else {"origin": case.place.world([case.origin])[0]}
        solution = ck.solve(case.scene(), case.spacing * case.place.scale, **options, **case.options)
        try:
            told = FACTOR * (solution.error.rms[: len(known)] + case.terms.get("floor", 0.0))
        except CpmkitError:
            told = np.full(len(known), UNESTIMATED_RMS)
    found = solution.eigenvalues[: len(known)] * case.place.scale**2
    unit = np.where(known > 0, known, known[known > 0][0])
    off, allowed = np.abs(found - known) / unit, np.maximum(np.where(np.isfinite(told), told, np.inf), SMALL_RMS)
    worst = int(np.argmax(off / allowed))
    said = [str(one.message) for one in heard] + list(solution.warnings)
    return verdict(float(off[worst]), float(allowed[worst]), tuple(dict.fromkeys(said)))


LAWS = {
    "exact": exact,
    "constant": exact,
    "pair": pair,
    "shift": shift,
    "superposition": superposition,
    "reciprocity": reciprocity,
    "total": total,
    "maximum": maximum,
    "eigenvalues": eigenvalues,
}
