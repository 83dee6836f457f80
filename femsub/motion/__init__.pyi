from .charts import (
    Track as Track,
    highest as highest,
    period_chart as period_chart,
    signals_chart as signals_chart,
    spectra_chart as spectra_chart,
    spectrogram_chart as spectrogram_chart,
)
from .compared import growth_in_time as growth_in_time, motion_row as motion_row, spectrograms as spectrograms
from .cycles.branch_chart import bifurcation_chart as bifurcation_chart
from .cycles.compared import cycles_verdict as cycles_verdict
from .cycles.compliance import small as small
from .cycles.continuation import PARAMETERS as PARAMETERS, with_parameter as with_parameter
from .cycles.families import (
    along as along,
    family_branches as family_branches,
    family_cycles as family_cycles,
    in_turn as in_turn,
    settled as settled,
    settled_over as settled_over,
)
from .cycles.hopf import range_around as range_around
from .cycles.initial_guess import onsets as onsets
from .nonlinear_model import project as project, sliding as sliding
from .self_excitation import table_rows as table_rows
from .signals import Spectrum as Spectrum, period_near as period_near
