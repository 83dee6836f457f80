"""Which method? The same reduced models with their interface on springs, from free to held."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub import CraigBampton, Substructure, normal_modes
from femsub.app.scene import Result
from femsub.app.scenes.component import UP_TO, Work
from femsub.checks import Array
from femsub.studies import Table, column, springs_chart

RATIOS = np.array([1e-4, 1e-2, 1.0, 10.0, 100.0, 1e4])  # of the springs to the component's own static stiffness at the interface


def interface_on_springs(work: Work) -> Result:
    """Error of the lowest frequencies of K + s Bᵀdiag(d)B, M, d_j the condensed stiffness at interface DOF j, over s."""
    sub = work.sub
    if not len(sub.interface):
        return Result({"joined-interface": []}, ["Interface on springs: the component has no interface DOF"])
    condensed = np.diag(work.reduce(CraigBampton(0)).K)[:len(sub.interface)]
    bare = sub.K.diagonal()[sub.interface]
    own = np.where(condensed > 1e-9 * bare, condensed, bare)
    rows: list[dict[str, Any]] = []
    for ratio in RATIOS:
        work.tell(f"interface on springs of {ratio:g} times its own stiffness")
        count = min(UP_TO, min(rom.size for _, rom in work.reduced))
        exact = _frequencies(sub, ratio * own, count)
        for method, rom in work.reduced:
            found = _frequencies(rom, ratio * own, count)
            rows.append({"model": method.key, "modes": method.modes, "size": rom.size, "springs": float(ratio),
                         "error": float(np.max(np.abs(found / exact - 1)))})
    models = {(row["model"], row["modes"]): {key: row[key] for key in ("model", "modes", "size")} for row in rows}
    for row in rows:
        models[row["model"], row["modes"]][f"{row['springs']:g}"] = row["error"]
    columns = ("model", "modes", "size", *(column(f"{ratio:g}", form=".1e") for ratio in RATIOS))
    head = (f"Interface on springs: largest error of the lowest {count} frequencies, over the springs' stiffness relative to the "
            "component's own at each interface DOF")
    title = f"{work.scene.name}: interface on springs, lowest {count} frequencies"
    return Result({"joined-interface": rows}, [
        head, Table("", list(models.values()), columns, keys=3), Table("joined-interface", rows, title="Interface on springs"),
        springs_chart(rows, title)])


def _frequencies(model: Substructure, springs: Array, count: int) -> Array:
    B = sp.csr_array(model.interface_rows)
    added = B.T @ sp.diags_array(springs) @ B
    if not sp.issparse(model.K):
        added = added.toarray()
    modes = normal_modes(Substructure(model.M, model.K + added, name=model.name), count=count)
    return modes.frequencies[modes.rigid:]
