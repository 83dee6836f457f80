"""A⁻¹B of the full model with A = K + S, S small, by a factor of the whole model or by the factors of a system's parts."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import BLOCK, DenseFactor, Difference
from femsub.checks import Array, Matrix, SingularMatrixError
from femsub.coupling import System, linked, rows_of_parts, sprung
from femsub.modes.quadratic.energy_basis import Term
from femsub.modes.shift_invert import ShiftInvert

if TYPE_CHECKING:
    from femsub.model import Substructure

log = logging.getLogger(__name__)

# Stiffness added to each DOF between the parts, relative to its own: it holds a floating system. If it is smaller, rounding in
# rigid motion dominates the solutions. If it is larger, modes far below it lose digits
SOFT = 1e-3
STATIC = 1e-9  # ‖K_ii Ψ + K_ib‖, relative to its terms, up to which basis columns count as constraint modes


class ByWhole:
    """A = K - σM by a factor of the whole model, S = -σM. K may include contact stiffness. `whole` is the reason for this way."""

    def __init__(self, K: Matrix, M: Matrix, why: str) -> None:
        handle = ShiftInvert(K, M)
        self.whole, self.factorisations, self._handle = why, handle.factorisations, handle
        self._A = Difference(handle.K, handle.M, handle.sigma)

    def product(self, X: Array) -> Array:
        return self._A @ X

    def solve(self, B: Array) -> Array:
        return self._handle.factor.solve(B)

    def terms(self, M: Matrix) -> list[Term]:
        """s²M - S: the terms of P(s) beside A, damping and contacts."""
        return [Term(M, (self._handle.sigma, 0.0, 1.0))]


class ByParts:
    """A = K + S, S = E diag(s) Eᵀ, E the DOF b between the parts, by the factors of the parts with their interfaces held:

        A⁻¹ = Σ_p K_ii,p⁻¹ + T S_b⁻¹ Tᵀ,   T = [I; Ψ],   S_b = K_bb + K_bi Ψ + diag(s),   Ψ = -K_ii⁻¹ K_ib.

    This is block elimination. Reductions by Craig-Bampton and Hurty have already computed the factors and Ψ. S_b (n_b, n_b) is
    dense.

    References
    ----------
    J. S. Przemieniecki, AIAA J. 1 (1963) 138; B. Smith, P. Bjorstad, W. Gropp, Domain Decomposition (1996), ch. 4.
    """

    whole = ""

    def __init__(self, full: System, rom: System) -> None:
        self._K = full.K
        self._parts: list[tuple[Array, ShiftInvert, Array, Matrix]] = []
        L, own = sp.csr_array(full.L), _apart(full)
        handles = {name: ShiftInvert(part.K, part.M, part.interior) for name, part in full.parts.items() if name in own}
        self.factorisations = sum(handle.factorisations for handle in handles.values())
        if loose := [name for name, handle in handles.items() if handle.floating]:
            raise SingularMatrixError(f"the interface does not hold {loose[0]!r}")
        places = {name: L[at.start + full.parts[name].interior].indices for name, at in own.items()}  # one entry per row
        self._b = np.setdiff1d(np.arange(full.size), np.concatenate(list(places.values())))
        condensed = full.K[self._b][:, self._b]
        condensed = condensed.toarray() if sp.issparse(condensed) else condensed
        for name, at in own.items():
            part, handle = full.parts[name], handles[name]
            loads = part.K[part.interior][:, part.interface]
            static = _constraint_modes(part, rom.parts[name], handle, loads)
            reach = L[at.start + part.interface][:, self._b]
            condensed += reach.T @ ((loads.T @ static) @ reach)
            self._parts.append((places[name], handle, static, reach))
        self._soft = SOFT * np.abs(condensed.diagonal())
        self._factor = DenseFactor((condensed + condensed.T) / 2 + np.diag(self._soft), "definite")

    def product(self, X: Array) -> Array:
        found = self._K @ X
        found[self._b] += self._soft[:, None] * X[self._b]
        return found

    def solve(self, B: Array) -> Array:
        found, load = np.zeros(B.shape), B[self._b]
        for place, handle, static, reach in self._parts:
            found[place] = handle.factor.solve(B[place])
            load = load + reach.T @ (static.T @ B[place])
        found[self._b] = self._factor.solve(load)
        for place, _, static, reach in self._parts:
            found[place] += static @ (reach @ found[self._b])
        return found

    def terms(self, M: Matrix) -> list[Term]:
        soft = sp.csr_array((self._soft, (self._b, self._b)), shape=M.shape)
        return [Term(M, (0.0, 0.0, 1.0)), Term(soft, (-1.0, 0.0, 0.0))]


def solve_of(full: Substructure, rom: Any, K: Matrix) -> ByWhole | ByParts:
    """`ByParts` if the full model is a system whose parts can be held at their interfaces, else `ByWhole`.

    K is the stiffness of the full model, with or without contact stiffness.
    """
    why = "it is no system of parts" if K is full.K else "a contact adds to its stiffness"
    if isinstance(full, System) and isinstance(rom, System) and K is full.K:
        why = _against(full)
        if not why:
            try:
                return ByParts(full, rom)
            except SingularMatrixError as error:
                why = str(error)
        log.info("%r is factorised as a whole: %s", full.name, why)
    return ByWhole(K, full.M, why)


def _apart(full: System) -> dict[str, slice]:
    """The rows in L of each part that has interior DOF and a physical interface."""
    return {name: at for (name, part), at in zip(full.parts.items(), rows_of_parts(full.parts), strict=True)
            if len(part.interior) and 0 < len(part.interface) == part.interface_rows.shape[0]}


def _against(full: System, widest: int = 5000) -> str:
    """Why a system cannot be solved by its parts; empty if it can.

    The DOF between the parts make a dense matrix. For `widest` DOF it takes 200 MB and some seconds to factorise.
    """
    if full.multipliers:
        return "it is assembled by multipliers"
    own = _apart(full)
    moved = sprung(full.parts, [linked(joint, full.parts) for joint in full.joints])
    for name, at in own.items():
        if moved[at.start + full.parts[name].interior].any():
            return f"a spring or damper acts on a port inside {name!r}"
    between = full.size - sum(len(full.parts[name].interior) for name in own)
    if between > widest:
        return f"it has {between} DOF between its parts, more than {widest}"
    return "" if own else "no part has DOF inside its interface"


def _constraint_modes(part: Substructure, rom: Any, handle: ShiftInvert, loads: Matrix) -> Array:
    """Ψ = -K_ii⁻¹ K_ib (n_i, n_b), from the reduced part's basis if it has constraint modes, else solved for."""
    columns, kinds = rom.interface, getattr(rom, "kinds", ())  # `kinds` of a reduced part
    if kinds and len(columns) == len(part.interface) and all(kinds[j] == "constraint" for j in columns):
        static = rom.V[np.ix_(part.interior, columns)]
        forces = handle.K @ static
        if np.linalg.norm(forces + loads) <= STATIC * (np.linalg.norm(abs(handle.K) @ abs(static)) + sp.linalg.norm(loads)):
            return static
    static = np.empty(loads.shape, order="F")
    for start in range(0, loads.shape[1], BLOCK):
        block = loads[:, start:start + BLOCK]
        static[:, start:start + BLOCK] = handle.factor.solve(-(block.toarray(order="F") if sp.issparse(block) else block))
    return static
