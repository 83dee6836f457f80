"""What reduced models are worth where their interface is on springs, from soft to stiff."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import scipy.sparse as sp

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result, Table, column, studies
from femsub.checks import InputError, PortWarning

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class SpringsAsk(Ask):
    """Error of the lowest frequencies of K + s Bᵀdiag(d)B, M, d_j the condensed stiffness at interface DOF j, over s."""

    springs: list[float] = key([1e-4, 1e-2, 1.0, 10.0, 100.0, 1e4], "stiffness of the springs over the part's own static "
                               "stiffness at the interface", above=0)
    lowest: int = key(8, "so many of the lowest elastic frequencies are compared", least=1, most=1000)

    KIND: ClassVar[str] = "springs"
    NEEDS: ClassVar[tuple[str, ...]] = ("reduce",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if len(scene.parts) > 1:
            raise InputError("springs are put under the interface of one part by itself, but the scene has several")

    def run(self, models: Models) -> Result:
        sub = models.full
        if not models.alone or not len(sub.interface):
            return Result({"springs": []}, ["Interface on springs: the part has no interface DOF"])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PortWarning)  # no port matters here
            condensed = np.diag(fs.reduce(sub, fs.CraigBampton(0)).K)[:len(sub.interface)]
        bare = sub.K.diagonal()[sub.interface]
        own = np.where(condensed > 1e-9 * bare, condensed, bare)
        count = min(self.lowest, min(one.model.size for one in models.reduced))

        def frequencies(model: Any, springs: Any) -> Any:
            B = sp.csr_array(model.interface_rows)
            added = B.T @ sp.diags_array(springs) @ B
            if not sp.issparse(model.K):
                added = added.toarray()
            modes = fs.normal_modes(fs.Substructure(model.M, model.K + added, name=model.name), count=count)
            return modes.frequencies[modes.rigid:]

        rows: list[dict[str, Any]] = []
        for ratio in self.springs:
            models.say(f"interface on springs of {ratio:g} times its own stiffness")
            exact = frequencies(sub, ratio * own)
            for one in models.reduced:
                found = frequencies(one.model, ratio * own)
                rows.append({**one.head, "springs": float(ratio), "error": float(np.max(np.abs(found / exact - 1)))})
        wide = {(row["model"], row["modes"]): {name: row[name] for name in ("model", "modes", "size")} for row in rows}
        for row in rows:
            wide[row["model"], row["modes"]][f"{row['springs']:g}"] = row["error"]
        columns = ("model", "modes", "size", *(column(f"{ratio:g}", form=".1e") for ratio in self.springs))
        return Result({"springs": rows}, [
            f"Interface on springs: largest error of the lowest {count} frequencies, over the springs' stiffness relative to the "
            "part's own at each interface DOF", Table("", list(wide.values()), columns, keys=3),
            Table("springs", rows, title="Interface on springs"),
            studies.springs_chart(rows, f"{models.scene.name}: interface on springs, lowest {count} frequencies")])
