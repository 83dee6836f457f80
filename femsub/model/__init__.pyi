from .affine import Affine as Affine
from .bands import (
    DOUBLE as DOUBLE,
    REAL_ROOT as REAL_ROOT,
    SMALL_SHARE as SMALL_SHARE,
    beyond as beyond,
    distance_outside as distance_outside,
    doubled as doubled,
    in_band as in_band,
    moving as moving,
    upper as upper,
    widened as widened,
    within as within,
)
from .changes import (
    AddedDamper as AddedDamper,
    AddedMass as AddedMass,
    AddedSpring as AddedSpring,
    Change as Change,
    ChangeTerm as ChangeTerm,
    JointChange as JointChange,
    added as added,
    as_changes as as_changes,
    displacements as displacements,
    full_dofs as full_dofs,
)
from .constraints import Freed as Freed, freed as freed
from .contact import (
    Contact as Contact,
    Contacts as Contacts,
    LinearContact as LinearContact,
    affine_fields as affine_fields,
    affine_functions as affine_functions,
    columns_of as columns_of,
    contacts_at as contacts_at,
    contacts_of as contacts_of,
    fields_of as fields_of,
    kinks_of as kinks_of,
    small_matrices as small_matrices,
    without as without,
)
from .digits import by_diagonal as by_diagonal, over_diagonal as over_diagonal, rounding_of as rounding_of
from .dof_map import AXES as AXES, LARGEST as LARGEST, MOTIONS as MOTIONS, TRANSLATIONS as TRANSLATIONS, DofMap as DofMap
from .estimate import SHARE as SHARE, Estimate as Estimate
from .expressions import (
    Expression as Expression,
    Factor as Factor,
    affine_of as affine_of,
    check_range as check_range,
)
from .families import (
    COLUMNS_ALONE as COLUMNS_ALONE,
    DUST as DUST,
    IRREGULAR as IRREGULAR,
    SAMPLES as SAMPLES,
    check_affine as check_affine,
    coefficients as coefficients,
    family_of as family_of,
)
from .inertia import Inertia as Inertia, Supported as Supported
from .intervals import Interval as Interval
from .jets import Jet as Jet
from .origin import Origin as Origin
from .pencil import (
    Pencil as Pencil,
    contact_matrix as contact_matrix,
    look_at_the_order as look_at_the_order,
    projected as projected,
)
from .rigid_motion import (
    MIXED as MIXED,
    SOFT as SOFT,
    Carried as Carried,
    Damped as Damped,
    Joined as Joined,
    RigidMotion as RigidMotion,
    Rubbing as Rubbing,
    Scaled as Scaled,
    Touched as Touched,
    annihilates_a_translation as annihilates_a_translation,
    bare as bare,
    by_places as by_places,
    changed as changed,
    coordinates as coordinates,
    costs as costs,
    costs_nothing as costs_nothing,
    driven as driven,
    elastic_forces as elastic_forces,
    found as found,
    is_rigid as is_rigid,
    loose_by_places as loose_by_places,
    of_few_digits as of_few_digits,
    pieces as pieces,
    rigid_count as rigid_count,
    rounding as rounding,
    size_of_products as size_of_products,
    soft_springs as soft_springs,
    units as units,
)
from .substructure import (
    ReducedSubstructure as ReducedSubstructure,
    Substructure as Substructure,
    checked_sets as checked_sets,
    usable_band as usable_band,
)
