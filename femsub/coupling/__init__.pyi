from .assembly import (
    System as System,
    couple as couple,
    linked as linked,
    rows_of_parts as rows_of_parts,
    sprung as sprung,
    units_of_energy as units_of_energy,
)
from .contacts.belt import (
    LAWS as LAWS,
    STICKING as STICKING,
    Belt as Belt,
    asked as asked,
    scalar_law as scalar_law,
    width_of as width_of,
    with_slope as with_slope,
)
from .contacts.brake import brake_meshes as brake_meshes
from .contacts.charts import friction_chart as friction_chart
from .cutting import PLACES as PLACES, cut_chain as cut_chain, cut_mesh as cut_mesh
from .dual import FORCE as FORCE
from .joints import Rigid as Rigid
