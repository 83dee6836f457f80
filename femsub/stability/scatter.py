"""Stability where parameters scatter: probabilities of instability with their intervals, and the importance of each input."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from femsub.checks import (
    Array,
    FemsubWarning,
    InputError,
    InputTypeError,
    Tally,
    listener,
    mapping,
    real_array,
    truth,
    until,
    warn,
    whole_number,
    word,
)
from femsub.model import Affine, Contacts, Substructure, family_of, usable_band
from femsub.output import Chart, Displayed, Table
from femsub.stability.exclusion import is_mirrored
from femsub.stability.labels import Labels, sources_of
from femsub.stability.margins import ModesAt
from femsub.stability.mode_families import grouped
from femsub.stability.parameter import pencils_of
from femsub.stability.scatter_chart import scatter_chart, scatter_tables

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, repr=False)
class ModeFamily:
    """Modes that grow at some samples and belong together by frequency and shape; see `Scatter.families`.

    Attributes
    ----------
    probability : float
        The share of the samples at which a mode of the family certainly grows.
    interval : (float, float)
        As in `Scatter`, for this family. Samples that are undecided or outside the box count in its upper end.
    undecided : float
        The share of the samples at which growth is undecided, samples outside the box included.
    frequency : (float, float)
        The least and the largest Im λ, in radians per unit of time.
    at : ndarray of int, shape (k,)
        The samples at which a mode of the family grows or is undecided.
    growth, omega : ndarray, shape (k,)
        Re λ and Im λ there. For a sample that was not solved alone, these are the centres of enclosures.
    """

    probability: float
    interval: tuple[float, float]
    undecided: float
    frequency: tuple[float, float]
    at: Array
    growth: Array
    omega: Array

    def __repr__(self) -> str:
        lo, hi = self.frequency
        return (f"ModeFamily: ω from {lo:.6g} to {hi:.6g} rad/time, grows with probability {self.probability:.3g} in "
                f"[{self.interval[0]:.3g}, {self.interval[1]:.3g}], Re λ up to {self.growth.max():.3g}")


@dataclass(frozen=True, eq=False, repr=False)
class Importance:
    """Sobol indices of each input, for instability and for the largest Re λ; NaN if these do not vary.

    Attributes
    ----------
    parameters : tuple of str
    first, total : ndarray, shape (q,)
        Shares of the variance of the indicator of instability: by this input alone, and with all its interactions. An undecided
        sample counts as one half.
    first_growth, total_growth : ndarray, shape (q,)
        The same for the largest Re λ in the band.
    base : int
        Number of samples of each of the q + 2 designs. 0 if nothing was computed.
    """

    parameters: tuple[str, ...]
    first: Array
    total: Array
    first_growth: Array
    total_growth: Array
    base: int

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {first:.2f} to {total:.2f}"
                           for name, first, total in zip(self.parameters, self.first, self.total, strict=True))
        return f"Importance: first to total index of {shares}; {self.base} samples each"


@dataclass(frozen=True, eq=False, repr=False)
class Scatter(Displayed):
    """The stability of a model whose parameters scatter, made by `scatter`.

    Attributes
    ----------
    parameters : tuple of str
    samples : ndarray, shape (m, q)
        Values of the parameters.
    verdict : ndarray of int, shape (m,)
        1 where a mode certainly grows, -1 where all decay, 0 where that is undecided or the sample is outside the box.
    growth, omega : ndarray, shape (m,)
        The largest Re λ in the band, and Im λ of that mode; NaN outside the box.
    probability : float
        The share of the samples at which a mode certainly grows.
    interval : (float, float)
        [P(surely unstable), P(surely unstable) + P(undecided)], widened by the sampling error.
    undecided : float
        The share of the samples with verdict 0.
    outside : float
        The share of the samples outside the box of the model; it is a part of `undecided`.
    families : tuple of ModeFamily
        The most probable first.
    importance : Importance
    confidence : float
    deviation : float
        The standard deviation of `probability`, from the replicates of the points.
    replicates : int
        Number of Sobol sequences of equal length, each scrambled independently.
    band : (lo, hi)
    solved : int
        Decompositions and eigenproblems that were computed.
    evidence : str
        'confirmed': at each sample in the box the spectrum is complete. 'not checked': at some it is not.
    cutoff : float

    Examples
    --------
    >>> import femsub as fs
    >>> from scipy import stats
    >>> two_mode = fs.Affine([[1, 0], [0, 1]], [[0.01, 0], [0, 0.01]],
    ...                      [(1.0, [[2, 1], [1, 2]]), ("mu", [[0, -4 / 3], [0, 0]])])
    >>> fs.scatter(two_mode, {"mu": stats.norm(0.7, 0.1)}, samples=256, importance=False)
    Scatter: mu over 256 samples; unstable with probability 0.309 in [0.253, 0.369] at 95 %, 0 % undecided; 1 family; confirmed
    """

    parameters: tuple[str, ...]
    samples: Array
    verdict: Array
    growth: Array
    omega: Array
    probability: float
    interval: tuple[float, float]
    undecided: float
    outside: float
    families: tuple[ModeFamily, ...]
    importance: Importance
    confidence: float
    deviation: float
    replicates: int
    band: tuple[float, float]
    solved: int
    evidence: str
    cutoff: float = np.inf

    def tables(self) -> list[Table]:
        """A row for each family of modes, one for each input, and one for each sample (this table is not printed)."""
        return scatter_tables("scatter", self)

    def chart(self, title: str = "Modes that grow where parameters scatter", labels: Mapping[str, str] | None = None) -> Chart:
        """The cloud of frequency over growth, the probability of each family of modes, and a tornado of the inputs.

        `labels` are the displayed names of the inputs, with units.
        """
        return scatter_chart("scatter", self, title, labels)

    def __repr__(self) -> str:
        count = len(self.families)
        return (f"Scatter: {', '.join(self.parameters)} over {len(self.samples)} samples; unstable with probability "
                f"{self.probability:.3g} in [{self.interval[0]:.3g}, {self.interval[1]:.3g}] at {100 * self.confidence:g} %, "
                f"{100 * self.undecided:.3g} % undecided; {count} famil{'y' if count == 1 else 'ies'}; "
                f"{self.evidence}{until(self.cutoff)}")

    def tornado(self, share: float = 0.1) -> Array:
        """P(surely unstable) where each input is among its lowest and its highest values, a `share` of each; shape (q, 2)."""
        ends = np.quantile(self.samples, [share, 1 - share], axis=0)
        grows = self.verdict > 0
        return np.array([[grows[side].mean() if side.any() else np.nan for side in (column <= lo, column >= hi)]
                         for column, lo, hi in zip(self.samples.T, *ends, strict=True)])


def scatter(model: Substructure | Affine, inputs: Mapping[str, Any], *, contacts: Contacts = None,
            band: tuple[float, float] | None = None, samples: int = 4096, covariance: Any = None, seed: int = 0,
            confidence: float = 0.95, importance: bool = True, progress: Callable[[str], None] | None = None) -> Scatter:
    """The probability that a mode grows, if parameters have distributions: P(surely unstable), P(undecided), and intervals.

    At each sample the model's own error bars, or the radii of a `BoxModel`, decide. A family of small dense matrices is not
    solved at each sample: its eigenvalues are enclosed from decompositions at fewer places.

    Parameters
    ----------
    model : Substructure or Affine
        Full or reduced; best is a `BoxModel`, which estimates its distance from the full model. Samples outside its box count as
        undecided, and a warning names the bound.
    inputs : mapping of str to a frozen distribution of scipy.stats
        Distributions of parameters of an `Affine`, or of fields of the contacts, which change in all contacts that have them.
    contacts : Belt, LinearContact or another contact, or a sequence of them, optional
        On the model's ports; None for an `Affine`.
    band : (lo, hi), optional
        Only modes with lo ≤ Im λ ≤ hi and |Re λ| ≤ hi, in radians per unit of time. Default: all, for a reduced model those up to
        its cut-off. Required for a sparse model above 2,000 DOF.
    samples : int
        The least number of samples. They are 9 to 16 scrambled Sobol sequences of equal length, a power of two.
    covariance : array_like, shape (q, q), optional
        For correlated inputs, in their order: a correlation matrix, or a covariance matrix with the variances of the
        distributions. It is the correlation of a Gaussian copula: that of the inputs if they are normal, otherwise that of their
        normal scores.
    seed : int
    confidence : float
        The confidence of each interval by itself, two-sided.
    importance : bool
        Whether Sobol indices are estimated, with up to a quarter more samples.
    progress : callable, optional
        Called with a line of text during the computation.

    Returns
    -------
    Scatter

    Raises
    ------
    InputError, InputTypeError
        An unknown parameter; other parameters without a value; an input that is no frozen distribution of one number; a matrix
        that is no covariance; all samples outside the box of the model.

    Warns
    -----
    FemsubWarning
        Samples lie outside the box of the model.

    Notes
    -----
    Each end of an interval is the wider one of two intervals. Clopper's and Pearson's interval takes all samples as independent.
    Student's interval uses the means of the replicates, since Sobol points need not be better than independent points. Importance
    is estimated by `scipy.stats.sobol_indices`. The index of a correlated input belongs to the part of it that inputs before it
    do not explain (by Cholesky's factor), so the order matters.

    References
    ----------
    C. J. Clopper, E. S. Pearson, Biometrika 26 (1934) 404; A. B. Owen, J. Complexity 14 (1998) 466 (scrambled points); A.
    Saltelli et al., Comput. Phys. Commun. 181 (2010) 259 (indices); T. A. Mara, S. Tarantola, Reliab. Eng. Syst. Saf. 107 (2012)
    115 (correlated inputs).

    Examples
    --------
    >>> import femsub as fs
    >>> from scipy import stats
    >>> two_mode = fs.Affine([[1, 0], [0, 1]], [[0.01, 0], [0, 0.01]],
    ...                      [(1.0, [[2, 1], [1, 2]]), ("mu", [[0, -4 / 3], [0, 0]]), ("k", [[1, 0], [0, 0]])])
    >>> found = fs.scatter(two_mode, {"mu": stats.norm(0.7, 0.1), "k": stats.uniform(0.0, 0.05)}, samples=1024)
    >>> found.families[0].probability == found.probability, bool(found.importance.first[0] > 0.9)
    (True, True)
    """
    # the question
    names = tuple(word("parameter", name) for name in mapping("inputs", inputs, "parameters and their distributions"))
    if not names:
        raise InputError('inputs has no parameter. Give one, e.g. {"mu": scipy.stats.norm(0.4, 0.05)}')
    laws = [_law(name, inputs[name]) for name in names]
    at = pencils_of(model, contacts, names)
    truth("importance", importance)
    whole_number("samples", samples, least=1, most=10**8)
    whole_number("seed", seed, least=0)
    level = real_array("confidence", confidence)
    if level.ndim or not 0 < level < 1:
        raise InputError(f"confidence must be a number between 0 and 1, not {confidence!r}")
    limits, say = usable_band(model, band), listener("progress", progress)
    factor = _factor(covariance, laws, names)
    rng = np.random.default_rng(seed)

    # samples: replicates first, then the designs of the Sobol indices
    power = max(0, int(np.ceil(np.log2(samples / 16))))
    replicates = int(np.ceil(samples / 2**power))
    scores = np.concatenate([_scores(len(names), power, rng) for _ in range(replicates)])
    count = len(scores)
    share = count // (4 * (len(names) + 2))  # of each design
    base = 2 ** (share.bit_length() - 1) if importance and len(names) > 1 and share > 1 else 0
    if base:
        both = _scores(2 * len(names), base.bit_length() - 1, rng)
        A, B = np.hsplit(both, 2)
        mixed = [np.where(np.arange(len(names)) == i, B, A) for i in range(len(names))]
        scores = np.concatenate([scores, A, B, *mixed])
    points = _values(laws, scores @ factor.T)
    if not np.isfinite(points).all():
        raise InputError(f"a sample of {names[int(np.argmin(np.isfinite(points).all(axis=0)))]} is not finite")

    # labels
    outside = _outside(model, names, points, count)
    labels = _labels(model, contacts, names, at, limits, points, ~outside, say)

    # probabilities
    certain, open_ = labels.verdict[:count] > 0, labels.verdict[:count] == 0
    interval, deviation = _interval(certain, open_, replicates, float(level))
    families = []
    number = grouped(labels.nodes, np.where(np.std(points, axis=0) > 0, np.std(points, axis=0), 1.0))
    hits = [(i, number[node], vote, value) for i, node, vote, value in labels.hits if i < count]
    for f in dict.fromkeys(hit[1] for hit in hits):
        mine = sorted((hit for hit in hits if hit[1] == f), key=lambda hit: hit[0])
        where, votes = np.array([hit[0] for hit in mine]), np.array([hit[2] for hit in mine])
        grows, doubt = np.zeros(count, dtype=bool), outside[:count].copy()
        grows[where[votes > 0]] = True
        doubt[where[votes == 0]] = True
        doubt &= ~grows
        values = np.array([hit[3] for hit in mine])
        omega = np.abs(values.imag)
        families.append(ModeFamily(float(grows.mean()), _interval(grows, doubt, replicates, float(level))[0], float(doubt.mean()),
                                   (float(omega.min()), float(omega.max())), where, values.real, omega))
    families.sort(key=lambda one: (-one.probability, one.frequency))
    complete = int((~outside).sum())
    result = Scatter(names, points[:count], labels.verdict[:count], labels.growth[:count], labels.omega[:count],
                     float(certain.mean()), interval, float(open_.mean()), float(outside[:count].mean()), tuple(families),
                     _importance(labels, names, count, base), float(level), deviation, replicates, limits, labels.solved,
                     Tally(complete, complete if labels.whole and not np.isnan(model.cutoff) else None, sampled=True).evidence,
                     np.inf if band is not None and not np.isnan(model.cutoff) else model.cutoff)
    log.info("%r", result)
    return result


def _law(name: str, value: Any) -> Callable[[Array], Array]:
    """The inverse of the distribution function of an input."""
    law = getattr(value, "icdf", None) or getattr(value, "ppf", None)
    if law is None or isinstance(value, type) or not (hasattr(value, "icdf") or hasattr(value, "dist")):
        raise InputTypeError(f"the input {name} must be a frozen distribution of scipy.stats, such as norm(0.4, 0.05), not "
                             f"{value!r}")
    if np.ndim(law(0.5)):
        raise InputError(f"the distribution of {name} must be a distribution of one number")
    return law


def _factor(covariance: Any, laws: Sequence[Any], names: Sequence[str]) -> Array:
    """L with LLᵀ the correlation of the normal scores, (q, q)."""
    if covariance is None:
        return np.eye(len(names))
    C = real_array("covariance", covariance)
    if C.shape != (len(names), len(names)) or not np.allclose(C, C.T, rtol=1e-9, atol=0.0) or not (C.diagonal() > 0).all():
        raise InputError(f"covariance must be a symmetric matrix of {len(names)} rows with a positive diagonal")
    variance = np.array([law.__self__.var() if hasattr(law.__self__, "var") else law.__self__.variance() for law in laws])
    if not np.allclose(C.diagonal(), 1.0) and not np.allclose(C.diagonal(), variance, rtol=1e-6):
        raise InputError(f"the diagonal of covariance must be 1, or the variances of the distributions, {variance}")
    size = np.sqrt(C.diagonal())
    square, vectors = np.linalg.eigh(C / np.outer(size, size))
    if square[0] < -1e-12 * square[-1]:
        raise InputError(f"covariance must not have a negative eigenvalue, but its correlation has {square[0]:.3g}")
    R = np.asarray(np.linalg.qr((vectors * np.sqrt(np.maximum(square, 0.0))).T, mode="r"))  # also of a singular one
    return np.asarray((R * np.where(R.diagonal() < 0, -1.0, 1.0)[:, None]).T)


def _scores(q: int, power: int, rng: np.random.Generator) -> Array:
    """2^power scrambled Sobol points as normal scores, (2^power, q)."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    engine = qmc.Sobol(q, scramble=True, rng=rng)
    return np.asarray(ndtri(engine.random_base2(power) + 0.5 / 2.0**engine.bits))  # never 0 or 1


def _values(laws: Sequence[Callable[[Array], Array]], scores: Array) -> Array:
    """The values of the inputs at normal scores (m, q)."""
    from scipy.special import ndtr

    return np.stack([np.asarray(law(ndtr(column)), dtype=float) for law, column in zip(laws, scores.T, strict=True)], axis=1)


def _outside(model: Any, names: Sequence[str], points: Array, count: int) -> Array:
    """Which points are outside the box of a model, bool (m,); a warning names the bounds."""
    found = np.zeros(len(points), dtype=bool)
    if not hasattr(model, "box"):
        return found
    said = []
    for name, column in zip(names, points.T, strict=True):
        for bound, word_, beyond in zip(model.box.ranges[name], ("lower", "upper"), (-1, 1), strict=True):
            out = beyond * (column - bound) > 0
            found |= out
            said += [f"{out[:count].mean():.2%} of {name} beyond the {word_} bound {bound:g}"] * bool(out[:count].any())
    if said:
        if found.all():
            raise InputError(f"all samples are outside the box of the model: {'; '.join(said)}")
        warn(f"samples outside the box of the model count as undecided: {'; '.join(said)}. Make a model of a larger box, or "
             "truncate the distribution", FemsubWarning)
    return found


def _labels(model: Any, contacts: Contacts, names: Sequence[str], at: Callable[[Mapping[str, float]], Any],
            limits: tuple[float, float], points: Array, among: Array, say: Callable[[str], None]) -> Labels:
    """The labels of the points: by leaves if the model is a dense family with damping, otherwise one by one."""
    left, family = np.flatnonzero(among), model
    ends = [at(dict(zip(names, points[i].tolist(), strict=True))) for i in left[[0, -1]]]
    solver = ModesAt(model, at, names, limits, ends, say)
    a, b = getattr(getattr(model, "box", None), "region", (-limits[1], limits[1]))[:2]
    labels = Labels(solver, points, (max(-limits[1], a), min(limits[1], b), *limits))
    if not isinstance(model, Affine):
        used = points[left]
        ranges = {name: (float(lo), float(hi)) for name, lo, hi in zip(names, used.min(axis=0), used.max(axis=0), strict=True)}
        try:
            family = family_of(model, contacts, names, ranges) if solver.small else None
        except InputError as error:
            log.info("no sum of matrices over %s: %s", ", ".join(names), error)
            family = None
    if family is not None and solver.small and not any(map(is_mirrored, ends)):
        left = labels.by_leaves(family, sources_of(family), left)
    labels.one_by_one(left)
    labels.with_nodes()
    return labels


def _interval(certain: Array, open_: Array, replicates: int, confidence: float) -> tuple[tuple[float, float], float]:
    """The interval of a probability, from P(certain) to P(certain or open_), with sampling errors; deviation of P(certain)."""
    from scipy.stats import beta, t

    m, tail = len(certain), (1 - confidence) / 2
    low, high = int(certain.sum()), int((certain | open_).sum())
    ends = [beta.ppf(tail, low, m - low + 1) if low else 0.0, beta.ppf(1 - tail, high + 1, m - high) if high < m else 1.0]
    means = [one.reshape(replicates, -1).mean(axis=1) for one in (certain, certain | open_)]
    deviations = [one.std(ddof=1) / np.sqrt(replicates) if replicates > 1 else 0.0 for one in means]
    if replicates > 1:
        wide = t.ppf(1 - tail, replicates - 1)
        ends = [min(ends[0], means[0].mean() - wide * deviations[0]), max(ends[1], means[1].mean() + wide * deviations[1])]
    return (float(max(ends[0], 0.0)), float(min(ends[1], 1.0))), float(deviations[0])


def _importance(labels: Labels, names: tuple[str, ...], count: int, base: int) -> Importance:
    """Sobol indices from the labels of the designs A, B, and A with a column of B."""
    if len(names) == 1:
        return Importance(names, one := np.ones(1), one, one, one, 0)
    found = np.full((4, len(names)), np.nan)
    if base:
        from scipy.stats import sobol_indices

        for k, figure in enumerate(np.stack([(labels.verdict[count:] + 1) / 2, labels.growth[count:]])):
            parts = figure.reshape(-1, base)
            if np.isfinite(figure).all() and np.ptp(parts[:2]) > 0:
                indices = sobol_indices(func={"f_A": parts[:1], "f_B": parts[1:2], "f_AB": parts[2:, None]}, n=base)
                found[2 * k:2 * k + 2] = indices.first_order.ravel(), indices.total_order.ravel()
    return Importance(names, found[0], found[1], found[2], found[3], base)
