from .cycles.continuation import PARAMETERS as PARAMETERS, with_parameter as with_parameter
from .cycles.initial_guess import of_signal as of_signal, onsets as onsets
from .nonlinear_model import project as project, sliding as sliding
from .signals import Spectrum as Spectrum
