"""Interface modes: the interface of a coupled system, or of a reduced part, moves in few shapes instead of DOF by DOF.

Parts that meet get the shapes of both (`with_common_shapes`), so that they can be joined again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from femsub.algebra import DEPENDENT, ROUNDING, comparable, congruent, groups
from femsub.checks import DENSE, EPS, Array, InputError, Matrix, NotConvergedError
from femsub.coupling import System, rows_of_parts, units_of_energy
from femsub.model import ReducedSubstructure, Substructure, units
from femsub.modes import ShiftInvert, all_modes
from femsub.reduction.basis import Basis, Partition, Statics, square, structural, zeros
from femsub.reduction.craig_bampton import condensed_stiffness
from femsub.reduction.estimates.nested import JOINED_RESIDUAL
from femsub.reduction.method import Method

KIND, INSIDE = "interface mode", "interior"  # labels of the coordinates
EXACT = 4096 * EPS  # part of a rigid motion that counts as rounding; without a larger part, a floating system would be held


@dataclass(frozen=True)
class InterfaceModes(Method):
    """Interface reduction: the lowest modes of the statically condensed interface (characteristic constraint modes).

    A system of reduced parts has interface coordinates b and the modal coordinates i of the parts. With S = -K_ii⁻¹ K_ib, the
    static response of the modal coordinates to interface displacements,

        K_c = K_bb + K_bi S,   M_c = [S; I]ᵀ M [S; I],   (K_c - ω²M_c) φ = 0,   φᵀ M_c φ = 1,
        V = [[I, S Φ], [0, Φ]],   V (n, n_i + m),

    in the order (i, b). All n_i modal coordinates stay. m coordinates replace the n_b interface coordinates.

    The interface consists of all interface DOF of the parts: joined DOF, each once, and open DOF. For Craig-Bampton parts, K does
    not couple it with the modes (S = 0). For parts with free modes (Rubin, Craig-Chang) it does. The modes of K_bb and M_bb alone
    would then be modes of the residual flexibility, and useless. If interface displacements are combinations of generalised
    coordinates, these are transformed first, so that some of them belong to the interface alone.

    The result's ``.expand(q)`` gives the coordinates of the system, and ``system.expand(small.expand(q))`` the displacements
    of each part. Open interface DOF are no longer coordinates, as with `CraigChang`.

    A reduced part is reduced further in the same way (local level). ``.expand(q)`` then gives its displacements. In
    ``reduce(system, {"disc": InterfaceModes(20), "pad": InterfaceModes(20)})`` parts that meet share the shapes of both.

    Parameters
    ----------
    modes : int
        Number m of interface modes; the rigid-body modes of a floating system are added to them.
    band : (lo, hi), with tol : float
        Instead of `modes`: the fewest modes that keep every mode of the system in the band within the relative error `tol`; see
        `reduce`. The error is that of the interface reduction alone, compared with the system before it.

    Raises
    ------
    InputError
        No interface; more modes than interface DOF; more than 4,000 interior coordinates, as in systems with full parts;
        a system of dual assembly.

    Notes
    -----
    A sparse eigensolver computes only the lowest modes. For n_b = 3,000 it takes as long as a few dense products. With a
    tolerance, dense eigenproblems of 2 n_i + m coordinates are solved, some ten times.

    References
    ----------
    M. P. Castanier, Y.-C. Tan, C. Pierre, AIAA J. 39 (2001) 1182; D. Krattiger et al., Mech. Syst. Signal Process. 114 (2019)
    579 (a survey; parts by themselves as well).

    Examples
    --------
    >>> import femsub as fs
    >>> left = fs.chain(30, interface=[26, 27, 28, 29, 30])
    >>> right = fs.chain(30, interface=[1, 2, 3, 4, 5], fixed=False)
    >>> parts = {name: fs.reduce(part, fs.CraigBampton(3), ports=True) for name, part in (("left", left), ("right", right))}
    >>> system = fs.couple(parts, [fs.Rigid(("left", range(25, 30)), ("right", range(5)))])
    >>> small = fs.reduce(system, fs.InterfaceModes(2), ports=True)
    >>> small
    ReducedSubstructure 'system': 10 of 12 DOF by 2 interface modes, cut-off 0.4279 rad/time
    >>> u = system.expand(small.expand(fs.normal_modes(small, count=1).shapes))
    >>> u["left"].shape, u["right"].shape
    ((30, 1), (30, 1))
    """

    key, label, colour, marker = "interface-modes", "Interface modes", "#117733", ">"
    takes_cutoff = False
    held, mode_kind = True, KIND
    offered = False

    def title(self, modes: int) -> str:
        return f"{modes} interface modes"

    def part(self, sub: Substructure) -> Partition:
        """The interface with the interior held, in coordinates that K does not couple.

        Compared with Craig-Bampton, the roles are exchanged: the interface is the interior of this partition, and the kept
        interior coordinates are its "interface".
        """
        if isinstance(sub, System) and sub.assembly == "dual":
            raise InputError(f"{sub.name!r} is of dual assembly, where K is indefinite; couple the parts with assembly='primal'")
        turn, b = _turned(sub)
        if not len(b):
            raise InputError(f"{sub.name!r} has no interface DOF, so that there are none to reduce. Name some as interface "
                             "of the parts, or use another method")
        i = np.setdiff1d(np.arange(sub.size), b)
        if len(i) > DENSE:
            raise InputError(f"{sub.name!r} has {len(i)} coordinates beside its {len(b)} interface DOF. Interface modes keep all "
                             f"of them, at most {DENSE}: reduce its parts first, e.g. by CraigBampton(modes=20)")
        K, M, D = (A if turn is None else congruent(A, turn) for A in (sub.K, sub.M, sub.D))
        if K[i][:, b].any() if isinstance(K, np.ndarray) else K[i][:, b].nnz:
            K, lift = _uncoupled(Substructure(M, K, None, b, name=sub.name))
            M, D = congruent(M, lift), congruent(D, lift)
            turn = lift if turn is None else turn @ lift
        M, K, D = (sp.csr_array(A) for A in (M, K, D))  # for the sparse eigensolver, which finds the lowest modes alone
        ports = sub.ports if turn is None else {name: turn.T @ w for name, w in sub.ports.items()}
        return Partition(Substructure(M, K, D, i, ports, sub.name), b, turn=turn)

    def static_columns(self, sub: Substructure) -> int:
        """The number of interior coordinates, all of which are kept."""
        return min(sub.size - len(_turned(sub)[1]), DENSE)  # `part` refuses more

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """The interior coordinates, unchanged, and the port columns whose static responses join the basis."""
        sub, i = part.sub, part.sub.interface
        if self.modes is not None and self.modes > handle.elastic:
            beside = f" beside {handle.rigid.shape[1]} rigid-body modes" if handle.floating else ""
            raise InputError(f"{self.modes} interface modes were asked for, but the interface of {sub.name!r} has "
                             f"{handle.elastic}{beside}")
        C = zeros(sub.size, len(i), extra.shape[1] + (len(i) if self.modes is None else self.modes))
        C[i, np.arange(len(i))] = 1.0
        return Statics(part, handle, C, square(sub.K, i), extra[part.rows], "static port")

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """The basis unchanged, except that the constraint columns are labelled as interior coordinates."""
        inside = statics.constraint.shape[1]
        return replace(basis, kinds=(INSIDE,) * inside + basis.kinds[inside:])

    def finished(self, sub: Substructure, model: ReducedSubstructure) -> ReducedSubstructure:
        """The model, with rounding added to its estimate. For a reduced part, V and the DOF numbers refer to the full part."""
        if (known := model.estimate) is not None:
            # adds the effect on ω and λ of a relative perturbation EPS in each entry of K. It is large if a floating stiff part
            # is joined to a soft one. The coordinates in which the modes are computed are uncoupled, and hide this rounding
            modes = all_modes(model.K, model.M, JOINED_RESIDUAL, model.rigid_motion)
            omega, x = modes.elastic, np.abs(model.V @ modes.shapes[:, modes.rigid:])
            if len(omega):
                share = EPS * np.einsum("ij,ij->j", x, abs(sub.K) @ x) / (2 * omega**2)
                of_omega, of_lambda = (share[np.abs(size[:, None] - omega).argmin(axis=1)]
                                       for size in (known.frequencies, np.abs(known.eigenvalues)))
                known = replace(known, frequency_error=known.frequency_error + of_omega,
                                eigenvalue_error=known.eigenvalue_error + of_lambda)
            if known.worst > known.tol:
                raise NotConvergedError(f"the interface of {sub.name!r} cannot be reduced to a relative error of {known.tol:g}, "
                                        f"by rounding alone: {known!r}. Reduce the stiffness contrast of its parts, raise tol, "
                                        "or give a number of modes")
            model = model._with(estimate=known, wider=model.wider)
        if not isinstance(sub, ReducedSubstructure):
            return model
        return replace(model, V=sub.V @ model.V, full_interface=sub.full_interface, full_dofs=sub.full_dofs,
                       method=f"{sub.method}, then {model.method}")


def _rows(sub: Substructure) -> Matrix:
    """B, sparse, shape (k, n): every interface DOF of the parts, also joined ones, in the coordinates of the system."""
    if not isinstance(sub, System):
        return sp.csr_array(sub.interface_rows)
    found = [_rows(part) @ sp.csr_array(sub.L[rows])
             for part, rows in zip(sub.parts.values(), rows_of_parts(sub.parts), strict=True)]
    return sp.csr_array(sp.vstack(found))


def _turned(sub: Substructure) -> tuple[Matrix | None, Array]:
    """T (n, n), x = T z, or None for the identity, and the indices in z of the interface: with these z = 0, B x = 0.

    A coordinate that is an interface DOF stays. Where B mixes generalised coordinates, z are orthonormal combinations of them in
    units of energy: first a basis of the row space of B, which moves the interface, then a basis of the null space.
    """
    import scipy.linalg as la

    n, unit = sub.size, comparable(units_of_energy({"": sub}))
    B = sp.csr_array(_rows(sub) @ sp.diags_array(unit))
    B.sum_duplicates()  # else abs(B) would do it, and change the order of the entries
    largest = abs(B).max(axis=1).toarray().ravel()
    B.data[np.abs(B.data) <= ROUNDING * np.repeat(largest, np.diff(B.indptr))] = 0.0
    B.eliminate_zeros()
    single = np.diff(B.indptr) == 1
    moves = np.zeros(n, dtype=bool)
    moves[B[np.flatnonzero(single)].indices] = True
    mixed = sp.csr_array(B[np.flatnonzero(~single)] @ sp.diags_array(np.where(moves, 0.0, 1.0)))
    mixed.eliminate_zeros()
    T = sp.lil_array(sp.eye_array(n))
    for rows, columns in groups(mixed):
        E = mixed[rows][:, columns].toarray()
        Q, R, _ = la.qr((E / np.linalg.norm(E, axis=1)[:, None]).T, pivoting=True, check_finite=False)
        pivots = np.abs(R.diagonal())
        moves[columns[:np.count_nonzero(pivots > DEPENDENT * pivots[0])]] = True
        T[np.ix_(columns, columns)] = unit[columns, None] * Q
    return (sp.csr_array(T) if mixed.nnz else None), np.flatnonzero(moves)


def _uncoupled(sub: Substructure) -> tuple[Array, Matrix]:
    """K in coordinates (interior, interface) that it does not couple, and T (n, n) with x = T z: [[I, S], [0, I]].

    If the interior can move rigidly with the interface fixed (a part on one hinge), S contains none of this motion.
    """
    i, b, n = sub.interior, sub.interface, sub.size
    loads = sub.K[i][:, b]
    loads = loads.toarray() if sp.issparse(loads) else loads
    shapes = np.zeros((n, len(b)))
    shapes[b, np.arange(len(b))] = 1.0
    shapes[i] = -Partition.of(sub, True).factored().elastic_solve(loads)
    K = np.zeros((n, n))
    K[np.ix_(i, i)] = square(sub.K, i)
    K[np.ix_(b, b)] = condensed_stiffness(sub, square(sub.K, b) + loads.T @ shapes[i], shapes)[0]
    return K, sp.csr_array(sp.eye_array(n)) + sp.csr_array(
        (shapes[i].ravel(), (np.repeat(i, len(b)), np.tile(b, len(i)))), shape=(n, n))


def with_common_shapes(system: System, models: Mapping[str, ReducedSubstructure]) -> dict[str, ReducedSubstructure]:
    """Parts whose interfaces were reduced one by one, with common shapes where they meet, so that they can be joined again.

    System coordinates that belong to the same parts form one group, for example those of an edge. In each group every part gets
    the shapes of all parts that meet there. If only one part was reduced, nothing changes: its neighbours keep all interface DOF,
    and follow its shapes.

    References
    ----------
    S.-K. Hong, B. I. Epureanu, M. P. Castanier, Mech. Syst. Signal Process. 37 (2013) 403; Krattiger et al. 2019 (local level
    with exact compatibility).
    """
    own = {name: model for name, model in models.items() if KIND in model.kinds}
    if len(own) < 2:
        return dict(models)
    if system.multipliers:
        raise InputError(f"{system.name!r} has joints by multipliers (Dual Craig-Bampton parts, or dual assembly), where parts "
                         "need not move alike. Reduce the interface of the whole system, as reduce(system, InterfaceModes(20))")
    unit, whole = comparable(units_of_energy({"": system})), ShiftInvert(system.K, system.M, carried=system.rigid_motion).rigid
    motion: dict[str, Matrix] = {}
    shapes: list[Array] = []
    member = np.zeros((system.size, len(own)), dtype=bool)
    for name, rows in zip(system.parts, rows_of_parts(system.parts), strict=True):
        if name in own:
            B = (sp.csr_array(system.parts[name].interface_rows) @ sp.csr_array(system.L[rows])).tocsc()
            at = np.flatnonzero(np.diff(B.indptr))
            member[at, len(shapes)], motion[name] = True, B
            B = B[:, at] @ sp.diags_array(unit[at])
            found = np.zeros((system.size, own[name].size))  # in units of energy
            inverse = B.power(-1).T if B.nnz == len(at) == B.shape[0] else np.linalg.pinv(B.toarray())
            found[at] = inverse @ own[name].interface_rows
            shapes.append(found)
    signature = np.unique(member, axis=0, return_inverse=True)[1]
    blocks: list[tuple[Array, Array, Array]] = []
    for group in (np.flatnonzero(signature == one) for one in np.unique(signature[member.any(axis=1)])):
        meets, size = member[group[0]], unit[group, None]
        # a shape is dropped if other shapes represent it except for a rounding of its energy
        met = np.hstack([found[group] for found, one in zip(shapes, meets, strict=True) if one])
        blocks.append((group, meets, size * _orthonormal((whole[group] / size, EXACT), (met, ROUNDING**0.5))))
    return dict(models) | {name: _in_shapes(
        system.parts[name], model, np.hstack([motion[name][:, group] @ block for group, meets, block in blocks if meets[at]]),
        motion[name] @ whole) for at, (name, model) in enumerate((name, own[name]) for name in motion)}


def _orthonormal(*stages: tuple[Array, float]) -> Array:
    """Orthonormal columns that span the columns (n, k) of all stages; new directions of a stage below its limit are dropped."""
    basis = np.zeros((len(stages[0][0]), 0))
    for columns, least in stages:
        found = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        for _ in range(2):
            found = found - basis @ (basis.T @ found)
        U, share, _ = np.linalg.svd(found, full_matrices=False)
        basis = np.hstack([basis, U[:, share > least]])
    return basis


def _in_shapes(part: Substructure, model: ReducedSubstructure, shapes: Array, rigid: Array) -> ReducedSubstructure:
    """The model with given shapes of the interface (n_b, k) and `rigid` motions (n_b, r) in place of its own."""
    turned = InterfaceModes(0).part(part)
    sub, i, b = turned.sub, turned.sub.interface, part.interface
    if part.size - len(i) != len(b):
        raise InputError(f"{part.name!r} is a system of its own, whose inner joints would lose their motion; reduce the "
                         "interface of the whole system instead")
    unit = units(sub.K)[b, None]
    Q = _orthonormal((rigid / unit, EXACT), (shapes / unit, EXACT))
    T = np.zeros((part.size, len(i) + Q.shape[1]))
    T[i, np.arange(len(i))] = 1.0
    T[b, len(i):] = unit * Q
    V = T if turned.turn is None else turned.turn @ T
    M, D, K = (congruent(A.toarray(), T) for A in (sub.M, sub.D, sub.K))
    found = replace(model, M=M, D=D, K=K, H=structural(part, V), V=V, ports={name: V.T @ w for name, w in part.ports.items()},
                    kinds=(INSIDE,) * len(i) + (KIND,) * Q.shape[1], modes=Q.shape[1],
                    method=f"{Q.shape[1]} interface shapes", full_interface=b, full_dofs=part.dofs, estimate=None)
    return InterfaceModes(0).finished(part, found)
