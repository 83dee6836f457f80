"""Components made here: chain, beam, plate, solid, and their meshes. In: geometry and material. Out: a `Substructure`."""

from femsub.components.beam import SUPPORTS as SUPPORTS
from femsub.components.build import not_negative as not_negative, pair as pair, per_part as per_part, proportional as proportional
from femsub.components.fields import node_rows as node_rows
from femsub.components.grids import annulus as annulus
from femsub.components.mesh import (
    CELLS as CELLS,
    Mesh as Mesh,
    boundary_faces as boundary_faces,
    corner_nodes as corner_nodes,
    corners_of as corners_of,
)
from femsub.components.mesh_checks import checked as checked
from femsub.components.patches import patch as patch, sides_of as sides_of
from femsub.components.solid import DIRECTIONS as DIRECTIONS, materials_of as materials_of
from femsub.components.solid_assembly import Material as Material, Pattern as Pattern, at_points as at_points
from femsub.components.solid_elements import (
    KINDS as KINDS,
    reference as reference,
    shape_functions as shape_functions,
    skfem as skfem,
)
from femsub.components.two_mode import two_mode_critical as two_mode_critical
from femsub.components.ziegler import ziegler_critical as ziegler_critical
