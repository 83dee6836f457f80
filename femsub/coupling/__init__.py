"""How parts meet: joints, ties and rigid links between them, cuts through them, and contacts that slide.

In: substructures and joints. Out: a `System`, which is a `Substructure` again.
"""

from femsub.coupling.assembly import System as System, couple as couple
from femsub.coupling.contacts.belt import (
    LAWS as LAWS,
    STICKING as STICKING,
    Belt as Belt,
    asked as asked,
    scalar_law as scalar_law,
    width_of as width_of,
    with_slope as with_slope,
)
from femsub.coupling.contacts.brake import brake_meshes as brake_meshes, check_held as check_held, opposite as opposite
from femsub.coupling.dual import FORCE as FORCE
from femsub.coupling.joined import (
    linked as linked,
    rows_of_parts as rows_of_parts,
    sprung as sprung,
    units_of_energy as units_of_energy,
)
