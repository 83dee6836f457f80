from .charts import (
    Track as Track,
    highest as highest,
    period_chart as period_chart,
    signals_chart as signals_chart,
    spectra_chart as spectra_chart,
    spectrogram_chart as spectrogram_chart,
)
from .cycles.branch_chart import bifurcation_chart as bifurcation_chart
from .cycles.compared import cycles_verdict as cycles_verdict
from .cycles.continuation import PARAMETERS as PARAMETERS, with_parameter as with_parameter
from .cycles.initial_guess import of_signal as of_signal, onsets as onsets
from .nonlinear_model import project as project, sliding as sliding
from .self_excitation import table_rows as table_rows
from .signals import Spectrum as Spectrum
