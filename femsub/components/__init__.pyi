from .beam import SUPPORTS as SUPPORTS
from .build import not_negative as not_negative, pair as pair, proportional as proportional
from .facing import Facing as Facing, covered as covered, warn_of_uncovered as warn_of_uncovered
from .fields import (
    joined_mesh as joined_mesh,
    joined_parts as joined_parts,
    joined_shapes as joined_shapes,
    moved_fields as moved_fields,
    node_rows as node_rows,
    turned as turned,
)
from .grids import annulus as annulus, line as line, mounted_disc as mounted_disc, ring as ring
from .mesh import (
    CELLS as CELLS,
    Mesh as Mesh,
    boundary_faces as boundary_faces,
    corner_nodes as corner_nodes,
    corners_of as corners_of,
    edges_of as edges_of,
    places_of as places_of,
)
from .mesh_checks import checked as checked
from .pictures import (
    draw_solid as draw_solid,
    parts_figure as parts_figure,
    shapes_figure as shapes_figure,
    shapes_window as shapes_window,
    triad as triad,
)
from .small_models import (
    disc_pair as disc_pair,
    two_mode as two_mode,
    two_mode_critical as two_mode_critical,
    ziegler as ziegler,
    ziegler_critical as ziegler_critical,
)
from .solid import DIRECTIONS as DIRECTIONS, materials_of as materials_of
from .solid_assembly import Material as Material, Pattern as Pattern, at_points as at_points
from .solid_elements import (
    KINDS as KINDS,
    reference as reference,
    side_quadrature as side_quadrature,
)
from .surfaces import Side as Side, Surface as Surface, common_points as common_points, reach as reach
