"""How a `BoxModel` is made: the count is proved in cells of the box, and vectors are taken where the error is largest.

One `Projection` serves the whole box: its reference has the middle of the range of each factor. The change of a factor with the
parameters is a term with |θ| ≤ half of the range. The number of eigenvalues in the band is proved for a whole cell of the box at
once (`femsub.modes.quadratic.cells`). A cell without a proof is halved in the parameter whose halving helps most.

A smaller basis inside the proved space makes the model fast: right and left eigenvectors of VᵀPV at a few values, as in N.
Gräbner, V. Mehrmann, S. Quraishi, C. Schröder, U. von Wagner, ZAMM 96 (2016) 1388, here with a control of the error (`Radii`).
Values are added where the error is largest (greedy algorithm: A. T. Patera, G. Rozza 2007, ch. 3).
"""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import by_threads, halves, is_symmetric
from femsub.checks import EPS, Array, FemsubWarning, InputError, SingularMatrixError, warn
from femsub.model import Affine, projected, usable_band
from femsub.modes import ComplexModes, Contour, Varied, count_over, eigenpairs, projection_over
from femsub.reduction.parameter_box import BoxModel, Cell, ParameterBox, Radii, Ranges
from femsub.reduction.states import Norms, Polynomials, Spaces, States, improved, inverse_beside, iterated, spread

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

log = logging.getLogger(__name__)

GAP = 0.1  #: share of the band's top by which the contour may move outwards, into gaps that no eigenvalue crosses
PLACES = 32  #: number of values at which the error is evaluated, for each parameter
SHOWN = 3  #: number of open cells that a warning names
VISITS = 4  #: number of values of a cell at which its states are tested
PAIRS = 40  #: number of factors of P(λ), of order m, that take half of the time of its eigenproblem (measured, m = 580)
STEPS = 3  #: largest number of inverse iterations of predicted pairs
NODES = 12  #: largest number of values whose eigenvectors are used, for each parameter


class Node(NamedTuple):
    """Values of the parameters, and the eigenpairs of VᵀPV inside the contour there, |zᴴP'(λ)x| = 1, x and z of equal length."""

    values: Mapping[str, float]
    theta: Array
    lam: Array
    x: Array
    z: Array


def over_box(family: Affine, box: ParameterBox) -> BoxModel:
    """The small model of a family over a box; see `reduce`. Warns of open cells, and of a tolerance that is not met."""
    model = _Maker(family, box, np.zeros((family.M[0][1].shape[0], 0))).made()
    if left := [cell for cell in model.cells if cell.number is None]:
        places = [f"{cell.where} ({cell.why})" for cell in left[:SHOWN]]
        more = f"; and {len(left) - SHOWN} more in .cells" if len(left) > SHOWN else ""
        tried = box.cells if box.ranges else 1
        warn(f"{model.open_share:.1%} of the box is not proved after {tried} cells: {'; '.join(places)}{more}. Take a smaller "
             f"box or band, or cells={4 * box.cells}", FemsubWarning)
    if model.error > box.tol:
        warn(f"the error over the box is estimated as {model.error:.1e} |λ|, above tol={box.tol:g}, with {model.size} shapes "
             f"from {len(model.values)} values. Take a smaller box", FemsubWarning)
    return model


def at_one_value(family: Affine, box: ParameterBox, shapes: Array) -> tuple[BoxModel, int]:
    """The projection of a family without parameters, and how many of its first columns span these shapes (n, k).

    The projection has as many eigenvalues in the contour as were counted. The last term of K may make the symmetric part of K
    indefinite.
    """
    maker = _Maker(family, box, shapes, whole=True)
    return maker.made(), maker.fixed


class _Maker:
    """One projection for the box, its cells, and the nodes. Their vectors and the given shapes span the small model."""

    def __init__(self, family: Affine, box: ParameterBox, shapes: Array, whole: bool = False) -> None:
        self.family, self.box, self.whole = family, box, whole
        usable_band(family, box.band)  # the cut-off of reduced parts may be lower
        lo, hi, _ = family.factor_ranges(box.ranges)
        if not np.isfinite([lo, hi]).all():
            raise InputError("a factor of the model may be infinite in the box: give other ranges of "
                             f"{', '.join(box.ranges)}, without its pole")
        terms = [(power, matrix) for power, several in ((2, family.M), (1, family.D), (0, family.K)) for _, matrix in several]
        middle, half = (lo + hi) / 2, (hi - lo) / 2
        varies = half > 0 if box.ranges else np.arange(len(terms)) == len(terms) - 1
        unsymmetric = np.array([power < 2 and not is_symmetric(matrix) for power, matrix in terms])
        turns, rubs = unsymmetric & varies, unsymmetric & (varies | bool(box.ranges)) & [power == 0 for power, _ in terms]
        # strong friction may make (K + Kᵀ)/2 indefinite: the reference is then the system without friction
        for self.middle in (middle, np.where(rubs, 0.0, middle))[:1 + rubs.any()]:
            self.varied = np.flatnonzero((half > 0) | (self.middle != middle))
            self.centre, self.half = (middle - self.middle)[self.varied], half[self.varied]
            # the reference has only the symmetric half of a varying unsymmetric term; its skew half joins the term of change
            halved = turns & np.isin(np.arange(len(terms)), self.varied)
            changes = [Varied(sp.csr_array(terms[q][1]), terms[q][0], float(size), float(self.middle[q]) if halved[q] else 0.0)
                       for q, size in zip(self.varied, np.abs(self.centre) + self.half, strict=True)]
            try:
                self.projection = projection_over((_halved(family, halved), self.middle), changes, box.region, GAP)
                break
            except SingularMatrixError as error:
                log.info("there is no projection: %s", error)
                singular = error
        else:
            raise singular
        self.unit = self.projection.unit
        self.joining = shapes / self.unit[:, None]
        if self.joining.shape[1]:
            self.joining /= np.sqrt(np.einsum("ij,ij->j", self.joining, self.projection.product(self.joining)))
            self.projection.add(self.joining)

    def theta(self, **values: float) -> Array:
        """The factors that vary, minus their values in the reference."""
        return (self.family.factors(**values) - self.middle)[self.varied]

    # the count

    def cells(self) -> list[Cell]:
        """The box in cells, each with the number of eigenvalues inside a contour, if that is proved."""
        waiting, done, tried = [Cell(self.box.ranges)], list[Cell](), 0
        while waiting and tried < self.box.cells:
            cell = waiting.pop(0)
            lo, hi, known = self.family.factor_ranges(cell.ranges)
            theta, half = ((lo + hi) / 2 - self.middle)[self.varied], (hi - lo)[self.varied] / 2
            self.projection = self.projection.changed(theta, half)
            count, tried = count_over(self.projection, self.box.region, GAP), tried + 1
            self.projection.counted = None  # it refers to the projection: the cycle would keep both in memory
            if count is not None:
                log.info("%d eigenvalues in %s over %s, margin %.2g", count.number, count.contour.where, cell.where, count.margin)
                done.append(replace(cell, contour=count.contour, number=count.number, margin=count.margin,
                                    sampled=not known.all(), why=""))
            else:
                log.info("%s is not proved: %s", cell.where, self.projection.why)
                halves = self._halves(cell.ranges, half) if cell.ranges else []
                waiting += [Cell(ranges, why=self.projection.why) for ranges in halves]
                done += [] if halves else [replace(cell, why=self.projection.why)]
        return done + waiting

    def _halves(self, ranges: Ranges, half: Array) -> list[Ranges]:
        """The two halves of a cell, in the parameter whose halving lowers the bound that failed most."""
        blamed = self.projection.blamed if self.projection.blamed.any() else np.ones(len(half))
        gains, halves = [], []
        for name, (lo, hi) in ranges.items():
            parts: list[Ranges] = [{**ranges, name: ends} for ends in ((lo, (lo + hi) / 2), ((lo + hi) / 2, hi))]
            left = np.max([np.subtract(*self.family.factor_ranges(part)[1::-1])[self.varied] / 2 for part in parts], axis=0)
            gains.append(float(blamed @ (1 - left / np.where(half > 0, half, np.inf))))
            halves.append(parts)
        return halves[int(np.argmax(gains))]

    # the basis

    def node(self, values: Mapping[str, float], contour: Contour) -> Node:
        """The eigenpairs of VᵀPV at these values."""
        theta = self.theta(**values)
        matrices = self.projection.changed(theta).matrices
        (shift, nu, x, z), *_ = eigenpairs(matrices, self.projection.outer.size)
        with np.errstate(all="ignore"):
            lam = shift + 1 / nu
        at = np.flatnonzero(contour.encloses(np.nan_to_num(lam, nan=np.inf, posinf=np.inf)) & (lam.imag >= 0))
        # with strong dashpots LAPACK's λ are inaccurate, and `learn` would find the radii too small
        return Node(values, theta, *improved(tuple(matrices), lam[at], x[:, at], z[:, at]))

    def predicted(self, values: Mapping[str, float], model: BoxModel) -> Node | None:
        """`node` in the contour of the cell, from the pairs of the small model; None unless they converge to all pairs there."""
        cell, theta = model.cell(**values), self.theta(**values)
        if cell.number is None or cell.contour is None:
            return None
        _, lam, x, z, _ = model.pairs(values)
        at = np.flatnonzero(cell.contour.encloses(lam))
        if len(at) + np.count_nonzero(lam[at].imag) != cell.number - 2 * model.free or not 0 < len(at) <= PAIRS:
            return None
        lam, (x, z) = lam[at], (self.W @ part[model.free:, at] for part in (x, z))
        matrices, again = tuple(self.projection.changed(theta).matrices), np.arange(len(at))
        for _ in range(STEPS):
            before, each = lam[again], by_threads(lambda k: iterated(matrices, lam[[k]], x[:, [k]], z[:, [k]]), again)
            lam[again], x[:, again], z[:, again] = (np.concatenate(part, axis=-1) for part in zip(*each, strict=True))
            near = EPS**0.5 * np.abs(lam)
            again = again[~(np.abs(lam[again] - before) <= near[again])]  # the error is about the square of the last change
            if not len(again):
                break
        else:
            return None
        apart = (np.abs(lam[:, None] - lam) > near) | np.eye(len(lam), dtype=bool)
        split = (lam.imag > 0) & (lam.imag <= near)  # may be two real λ
        return Node(values, theta, lam, x, z) if apart.all() and cell.contour.encloses(lam).all() and not split.any() else None

    def allowed(self, lam: Array) -> Array:
        """√(c tol |λ|): residuals of this size on both sides cause an error of tol |λ|."""
        return np.sqrt(self.c * self.box.tol * np.maximum(np.abs(lam), self.box.still))

    def error(self, modes: ComplexModes) -> float:
        """The largest radius of a λ, relative to |λ|. Rigid motion is excluded: its λ is 0 but for rounding."""
        size = np.abs(modes.eigenvalues)
        moving = size > self.box.still
        return float(np.max(modes.error_bar[moving] / size[moving], initial=0.0))

    def enriched(self, nodes: list[Node], new: int) -> list[Node]:
        """The nodes, after V was extended by A⁻¹ times residuals of the last `new` nodes, as far as the tolerance requires."""
        columns = []
        for node in nodes[-new:]:
            here = self.projection.changed(node.theta)
            scale = self.allowed(node.lam)
            for vectors, adjoint in ((node.x, False), (node.z, True)):
                columns.append(here.coefficients(node.lam, vectors / scale, adjoint))
        m = self.projection.size
        del here  # it would keep the old V in memory beside its longer copy
        if not self.projection.join(columns, 0.03):  # a limit for squares: directions with a sixth of the allowed residual join
            return nodes
        self.projection.lost  # noqa: B018  (computed once, since `changed` copies it)
        more = ((0, self.projection.size - m), (0, 0))
        nodes = [node._replace(x=np.pad(node.x, more), z=np.pad(node.z, more)) for node in nodes]
        for node in nodes[-new:]:  # components in the new columns, to first order
            matrices = self.projection.changed(node.theta).matrices
            for k, lam in enumerate(node.lam):
                right, left = (np.tensordot([1.0, lam, lam * lam], part, 1) for part in (matrices[:, m:], matrices[:, :, m:]))
                node.x[m:, k] = -la.solve(right[:, m:], right[:, :m] @ node.x[:m, k])
                node.z[m:, k] = -la.solve(left[m:].conj().T, left[:m].conj().T @ node.z[:m, k])
        return nodes

    def made(self) -> BoxModel:
        """The small model over the box."""
        box, names = self.box, list(self.box.ranges)
        cells = self.cells()
        lo, hi = np.array(list(box.ranges.values())).reshape(-1, 2).T
        sides = np.array([cell.contour.sides for cell in cells if cell.contour is not None] or [self.projection.outer.sides])
        contour = Contour(sides=(sides[:, 0].min(), sides[:, 1].max(), sides[:, 2].max()))
        self.projection = self.projection.changed(self.centre, self.half)
        self.projection.lost  # noqa: B018  (as above)
        c = self.projection.least
        self.c = self.least = c if c > 0 else 1.0  # of the whole box; `learn` corrects it
        self.kept = 1.0  # a direction of the vectors is kept if its residual exceeds this share of the allowed residual
        corners = [dict(zip(names, corner, strict=True)) for corner in product(*box.ranges.values())]
        each = by_threads if names else map  # one eigenproblem alone takes all threads of BLAS
        nodes = self.enriched(list(each(lambda corner: self.node(corner, contour), corners)), len(corners))
        middle = dict(zip(names, ((lo + hi) / 2).tolist(), strict=True))
        # corners as well: of their vectors, the basis has only the directions that were `kept`
        places = [middle, *(corners + _places(box.ranges, PLACES * len(names)) if names else [])]
        train = np.array([list(place.values()) for place in places])
        at, errors = 0, np.full(len(places), np.inf)
        model = self.small(nodes, cells)
        for _ in range(NODES * max(len(names), 1)):
            new, known = self.predicted(places[at], model) or self.node(places[at], contour), self.least
            self.learn(model, new)
            errors = errors * (known / self.least)
            if errors.max() <= box.tol and self.least > known / 2:  # the estimate holds at a new value as well
                break
            del model  # frees memory for the next one
            nodes = self.enriched([*(one for one in nodes if one.values != new.values), new], 1)
            model = self.small(nodes, cells)
            again = errors >= min(box.tol, errors.max())  # more shapes do not make an error larger
            found = model.modes_over(**dict(zip(names, train[again].T, strict=True))) if names else [model.modes()]
            before, errors = errors, errors.copy()
            errors[again] = [self.error(one) for one in found]
            log.info("%d values, %d shapes: error %.1e", len(nodes), model.size, errors.max())
            at, self.kept = int(errors.argmax()), self.kept / 4  # more shapes: more values alone may not suffice
            if self.whole and errors[0] > before[0] / 2:  # rounding
                break
        model = model._with(radii=replace(model.radii, least=self.least), error=float(errors.max()))
        return self.listing(model, len(places) - len(corners) * bool(names))

    def small(self, nodes: list[Node], cells: list[Cell]) -> BoxModel:
        """The small model whose basis is made of the vectors of these nodes."""
        projection = self.projection
        columns = []
        for node in nodes:
            scale = self.allowed(node.lam)
            columns += [*real_parts(node.x / scale), *real_parts(node.z / scale)]
        vectors = np.hstack(columns)
        # the given shapes, at unit energy; free rigid motion among them is only rounding here
        known, share, _ = np.linalg.svd(self.projection.V.T @ self.projection.product(self.joining), full_matrices=False)
        known = known[:, share > EPS**0.5]
        self.fixed = projection.free.shape[1] + known.shape[1]
        if self.whole:
            W = np.hstack([known, la.null_space(known.T)]) if known.shape[1] else np.eye(len(known))
        else:
            U, size, _ = la.svd(vectors - known @ (known.T @ vectors), full_matrices=False)
            W = np.hstack([known, U[:, size > self.kept]])
        if not W.shape[1]:
            W = np.eye(len(U))  # without an eigenvalue: of some of the shapes alone one may lie inside
        H, _ = projection.images_outside()
        d, m = W.shape[1], projection.size
        blocks = np.zeros((m + H.shape[1], 1 + len(H), d))  # of A and of each term, inside V and outside
        blocks[:m, 0] = projection.energy @ W
        blocks[:m, 1:] = (projection.inside @ W).transpose(1, 0, 2)
        blocks[m:, 1:] = (H @ W).transpose(1, 0, 2)
        del H
        # only lengths and angles matter: the images are rotated, and directions negligible beside the allowed residual dropped
        largest = projection.changed(np.abs(self.centre) + self.half).terms
        scale = np.array([1.0, *(term.largest(projection.outer.size) or 1.0 for term in largest)])[:, None, None]
        blocks *= scale[:, 0]
        R = np.asarray(np.linalg.qr(blocks.reshape(len(blocks), -1), mode="r"))
        del blocks
        mix = la.eigh(R @ R.T)[1].T @ R  # lengths from the rows: square roots of the eigenvalues have half of the digits
        length = la.norm(mix, axis=1)
        allowed = 0.1 / np.fmax(max(float(la.norm(part, axis=0).max(initial=0.0)) for part in columns), EPS)
        kept = length > max(allowed, len(length) * EPS * length.max())
        mix = mix.T.reshape(len(scale), d, -1) / scale
        lost = np.array([la.norm(part, 2) for part in mix[..., ~kept]]) if not kept.all() else np.zeros(len(scale))
        mix = mix[..., kept]
        rounding = float(np.finfo(np.float32).eps) * la.norm(mix, axis=(1, 2))
        if rounding @ scale.ravel() <= max(lost @ scale.ravel(), allowed / 10):  # no more than what was dropped, or negligible
            mix, lost = mix.astype(np.float32), lost + rounding
        places = np.array([-1 if place is None else place for place, _ in projection.own_weights])
        base = np.array([weights for _, weights in projection.own_weights])
        signs = np.array([term.sign for term in projection.terms])
        self.W, V = W, projection.V @ W
        radii = Radii(mix, lost, signs, places, np.array(projection.held), base, projection.sizes(V), self.least)
        V = np.hstack([projection.free, V]) if projection.free.size else V
        V *= self.unit[:, None]
        family = self.family._each(lambda theta, A: (theta, projected(A, V)))
        model = BoxModel(family.M, family.D, family.K, box=self.box, cells=tuple(cells), V=V, radii=radii, middle=self.middle,
                         varied=self.varied, free=projection.free.shape[1], error=np.inf,
                         values=np.array([list(node.values.values()) for node in nodes]))
        model = model._with(cutoff=float(np.minimum(model.cutoff, self.family.cutoff)))  # NaN if the family's is unknown
        self.share = self.kept
        return model

    def listing(self, model: BoxModel, most: int) -> BoxModel:
        """The model with states for each cell, from at most `most` nodes."""
        return model._with(cells=tuple(replace(cell, states=self.states(model, cell, most)) for cell in model.cells))

    def states(self, model: BoxModel, cell: Cell, most: int) -> States | None:
        """The states of a cell that give most pairs; None if these are less than half, or if a node has another number of λ."""
        d, number, unit = model.size - model.free, (cell.number or 0) - 2 * model.free, self.projection.outer.size
        if not cell.ranges or cell.contour is None or not 0 < number < 1.5 * d:
            return None
        contour, over = cell.contour, Polynomials.of(cell.ranges, most)
        spaces, tried, inverse = list[Spaces](), list[tuple[float, float, States]](), Norms()

        def solved(place: Sequence[float]) -> tuple[Norms, tuple[Any, Array, Array, Array]]:
            matrices = model.moving(model.factors(**dict(zip(cell.ranges, place, strict=True))))
            lam, x, z = model.every(matrices)
            inside = contour.encloses(lam)
            at, beyond = np.flatnonzero(inside), np.flatnonzero(~inside)
            scale = self.allowed(lam[at]) * self.share / 6  # directions shorter than 1 are negligible
            beside = inverse_beside(lam[at[lam[at].imag >= 0]], lam[beyond], x[:, beyond], z[:, beyond])
            return beside, (matrices, lam[at], x[:, at] / scale, z[:, at] / scale)

        for count in over.counts:
            for beside, found in by_threads(solved, over.nodes[len(spaces):count].tolist()):
                if len(found[1]) != number:
                    return None
                spaces.append(Spaces.of(*found, unit, *spaces[:1]))
                inverse = inverse.joined(beside)
            states = replace(States.of(over, spaces, unit), inverse=inverse)
            tried.append((*self.lacking(model, cell, states), states))
            largest = [one[1] for one in tried]
            known = 3 if tried[-1][0] else 1  # one or two higher degrees may gain nothing, and pairs that lack cost more
            if len(tried) > known and largest[-1] > largest[-1 - known] / 2:  # the rest is the error of the model itself
                break
        lacking, _, states = min(tried, key=lambda one: (one[0], one[1] > 2 * min(largest)))
        if lacking >= number / 2:
            return None  # iterating each pair takes as long as solving the whole eigenproblem
        return replace(states, inverse=inverse)

    def lacking(self, model: BoxModel, cell: Cell, states: States) -> tuple[float, float]:
        """The mean number of pairs that these states do not give without iteration, and the largest radius over |λ|."""
        def missing(place: Mapping[str, float]) -> tuple[int, float]:
            (lam, _, _, size), _, lacking, _ = model.on(cell, states, place)
            return abs(lacking), float((size / np.maximum(np.abs(lam), self.box.still)).max()) if len(lam) else np.inf

        lacking, largest = zip(*by_threads(missing, _places(cell.ranges, VISITS)), strict=True)
        return float(np.mean(lacking)), max(largest)

    def learn(self, model: BoxModel, node: Node) -> None:
        """Correct `least` at a node whose vectors are not in the model: a third of the smallest ‖R‖ ‖L‖ / |δλ| found so far."""
        found = model.modes(**node.values)
        far = np.abs(found.eigenvalues[:, None] - node.lam).min(axis=1, initial=np.inf)
        counts = (far > EPS**0.75 * np.abs(found.eigenvalues)) & ~found.rigid  # others are rounding
        self.least = min(self.least, float(np.min(found.error_bar[counts] / far[counts], initial=np.inf)) * model.radii.least / 3)


def _halved(family: Affine, chosen: Array) -> Affine:
    """The family with the symmetric halves of the chosen terms."""
    each = iter(chosen)
    return family._each(lambda theta, A: (theta, halves(A)[0] if next(each) else A))


def _places(ranges: Ranges, count: int) -> list[dict[str, float]]:
    """Values that are evenly spread over a box."""
    lo, hi = np.transpose(list(ranges.values()))
    return [dict(zip(ranges, row, strict=True)) for row in (lo + (hi - lo) * spread(count, len(ranges))).tolist()]


def real_parts(vectors: Array) -> list[Array]:
    """Real and imaginary parts of vectors, each multiplied by the phase that makes it as real as possible."""
    turned = vectors * np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", vectors, vectors)))
    return [turned.real, turned.imag]
