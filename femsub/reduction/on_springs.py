"""Errors of reduced models whose interface is held by springs, from soft to stiff."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, PortWarning
from femsub.model import Substructure
from femsub.modes.normal_modes import normal_modes
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.reduce import reduce


def interface_stiffness(sub: Substructure) -> Array:
    """d_j (nb,), the stiffness condensed to each interface DOF j; K_jj where the condensed stiffness is 0 (floating part)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PortWarning)  # no port matters here
        condensed = np.diag(reduce(sub, CraigBampton(0)).K)[:len(sub.interface)]
    bare = sub.K.diagonal()[sub.interface]
    return np.where(condensed > 1e-9 * bare, condensed, bare)


def errors_on_springs(full: Substructure, models: Sequence[Substructure], springs: Array, count: int) -> list[float]:
    """For each model, the largest relative error of its lowest `count` frequencies with K + Bᵀdiag(s)B, springs s (nb,)."""
    def frequencies(model: Substructure) -> Array:
        B = sp.csr_array(model.interface_rows)
        added = B.T @ sp.diags_array(springs) @ B
        K = model.K + (added if sp.issparse(model.K) else added.toarray())
        return normal_modes(Substructure(model.M, K, name=model.name), count=count).elastic

    exact = frequencies(full)
    return [float(np.max(np.abs(frequencies(model) / exact - 1))) for model in models]
