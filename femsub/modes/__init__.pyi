from .charts import (
    eigenvalue_chart as eigenvalue_chart,
    response_chart as response_chart,
    springs_chart as springs_chart,
)
from .dense import semidefinite_frequencies as semidefinite_frequencies
from .frequency_substructuring import couple_responses as couple_responses, virtual_point as virtual_point
from .mode_names import ModeName as ModeName, check_full as check_full, named as named, parts_energies as parts_energies
from .mode_set import ModeSet as ModeSet
from .normal_modes import (
    ACCEPTED as ACCEPTED,
    NormalModes as NormalModes,
    all_modes as all_modes,
    count_deferred as count_deferred,
    lowest_modes as lowest_modes,
    modes_below as modes_below,
    modes_under as modes_under,
)
from .quadratic.axis_sweep import AxisSweep as AxisSweep, Line as Line, Met as Met
from .quadratic.bars import bars as bars
from .quadratic.complex_modes import (
    ComplexModes as ComplexModes,
    beside_the_full as beside_the_full,
    complex_modes as complex_modes,
    modes_over as modes_over,
    pencil_of as pencil_of,
    with_bars as with_bars,
)
from .quadratic.correction import (
    Inverse as Inverse,
    corrected as corrected,
    left_by_symmetric_factor as left_by_symmetric_factor,
    left_slope as left_slope,
    slope as slope,
    solver_near as solver_near,
)
from .quadratic.dense import (
    ModalForm as ModalForm,
    definite_form as definite_form,
    eigenvalues as eigenvalues,
    modal_form as modal_form,
    solve as solve,
)
from .quadratic.energy_basis import (
    Coupling as Coupling,
    each_of as each_of,
    eigenpairs as eigenpairs,
)
from .quadratic.matching import (
    NEAR as NEAR,
    angle_between as angle_between,
    assigned as assigned,
    clusters as clusters,
    extra_eigenvalues as extra_eigenvalues,
    force_error as force_error,
    frequency_error as frequency_error,
    held_error as held_error,
    held_frequencies as held_frequencies,
    likeness as likeness,
    listed as listed,
    match as match,
    relative_error as relative_error,
    rows_beside as rows_beside,
    spectrum_errors as spectrum_errors,
    turnover as turnover,
    undamped as undamped,
)
from .quadratic.port_function import PortFunction as PortFunction
from .quadratic.projected_count import (
    UNCOUNTED as UNCOUNTED,
    Projection as Projection,
    Varied as Varied,
    few_columns as few_columns,
)
from .quadratic.region import Contour as Contour, Count as Count, Region as Region, region_of as region_of
from .quadratic.search import count_over as count_over, projection_over as projection_over, search as search
from .quadratic.singular_mass import REGULAR as REGULAR
from .quadratic.window_sweep import WindowSweep as WindowSweep, first_turn as first_turn
from .receptance import (
    FrequencyResponse as FrequencyResponse,
    frequency_response as frequency_response,
    port_responses as port_responses,
)
from .shift_invert import IN_PARTS as IN_PARTS, ShiftInvert as ShiftInvert, motion_of as motion_of
from .static_shapes import (
    energy_directions as energy_directions,
    independent as independent,
    lightest as lightest,
)
