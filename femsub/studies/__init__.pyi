from .error_vs_time import all_frequencies as all_frequencies, border_or_reason as border_or_reason, elastic as elastic
from .friction_sweep import (
    FrictionRow as FrictionRow,
    compared as compared,
    first_loss as first_loss,
    over_mu as over_mu,
    same_loss as same_loss,
)
from .results import Row as Row, Study as Study
from .self_excitation import table_rows as table_rows
from .tables import fitted as fitted, table as table, yes_no as yes_no
