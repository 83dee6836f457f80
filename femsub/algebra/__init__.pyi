from .counted_beside import CountBeside as CountBeside, SignsBeside as SignsBeside, signs as signs
from .elimination import (
    Equations as Equations,
    comparable as comparable,
    congruent as congruent,
    eliminate as eliminate,
    groups as groups,
    independent as independent,
    known_sums as known_sums,
    largest as largest,
    links_without_rounding as links_without_rounding,
    product as product,
    reach as reach,
    recovered as recovered,
    units as units,
    without_dust as without_dust,
)
from .factor import (
    ComplexFactor as ComplexFactor,
    DenseFactor as DenseFactor,
    Handle as Handle,
    are_definite as are_definite,
    counting as counting,
    factorise as factorise,
    factors_made as factors_made,
    forget_factor as forget_factor,
    fork_pays as fork_pays,
    inertia as inertia,
    negative_eigenvalues as negative_eigenvalues,
    release as release,
    shared_factor as shared_factor,
    solved as solved,
)
from .frozen import Frozen as Frozen
from .installed import examine as examine
from .matrices import (
    Difference as Difference,
    Sum as Sum,
    as_matrix as as_matrix,
    block_diagonal as block_diagonal,
    diagonal as diagonal,
    equilibration as equilibration,
    halves as halves,
    is_identity as is_identity,
    is_symmetric as is_symmetric,
    norm as norm,
    plus as plus,
    rows_of_zeros as rows_of_zeros,
    same as same,
    scaled as scaled,
    slabs as slabs,
    translations as translations,
    unit_length as unit_length,
    upper as upper,
    weighted as weighted,
    without_rounding as without_rounding,
    without_signs as without_signs,
)
from .memory import (
    BLOCKS as BLOCKS,
    check_columns as check_columns,
    check_memory as check_memory,
    check_room as check_room,
    has_room_to_count as has_room_to_count,
    kept_free as kept_free,
    reduction_bytes as reduction_bytes,
    search_columns as search_columns,
)
from .null_spaces import (
    DEPENDENT as DEPENDENT,
    ROUNDING as ROUNDING,
    SINGULAR as SINGULAR,
    SUMS as SUMS,
    factor_of_mass as factor_of_mass,
    massless_apart as massless_apart,
    null_space as null_space,
    rank_of_mass as rank_of_mass,
    row_space as row_space,
    sizes as sizes,
    undamped as undamped,
    unresisted as unresisted,
    without as without,
)
from .ordering import smooth_shape as smooth_shape
from .partitioning import partition as partition, runs as runs
from .petsc import (
    SparseFactor as SparseFactor,
    Transposed as Transposed,
    quadratic_modes as quadratic_modes,
    symmetric_modes as symmetric_modes,
)
from .processes.about import commit as commit, machine as machine
from .processes.beside import (
    columns_left as columns_left,
    completed as completed,
    divided as divided,
    give_back_cores as give_back_cores,
    shared_zeros as shared_zeros,
)
from .processes.cache import shared as shared
from .processes.folders import (
    identity as identity,
    lock as lock,
    only_one as only_one,
    opened as opened,
)
from .processes.limits import (
    BLOCK as BLOCK,
    FEW as FEW,
    LARGE as LARGE,
    QUADRATIC as QUADRATIC,
    SMALL as SMALL,
    WIDE as WIDE,
    WORK as WORK,
)
from .processes.memory import available as available, most_memory as most_memory, reused_memory as reused_memory
from .processes.parts import check_workers as check_workers, side_by_side as side_by_side
from .processes.stored import (
    DamagedFileError as DamagedFileError,
    Files as Files,
    files_of as files_of,
    load as load,
    store as store,
)
from .processes.system import own_processors as own_processors, processors as processors, variable as variable
from .processes.threads import (
    by_threads as by_threads,
    libraries as libraries,
    one_thread as one_thread,
    times as times,
)
from .subspace import Room as Room, orthonormal as orthonormal
from .timing import phase as phase, timed as timed
