from .error_vs_time import all_frequencies as all_frequencies, elastic as elastic
from .losses import Loss as Loss, affine_over as affine_over, first_loss as first_loss
from .results import Row as Row, Study as Study
from .self_excitation import table_rows as table_rows
from .tables import fitted as fitted, table as table, yes_no as yes_no
