"""Nonlinear motion in time. In: a model and its belts. Out: transients, and the evaluation of signals."""

from femsub.motion.cycles.continuation import PARAMETERS as PARAMETERS, with_parameter as with_parameter
from femsub.motion.cycles.initial_guess import of_signal as of_signal, onsets as onsets
from femsub.motion.nonlinear_model import project as project, sliding as sliding
from femsub.motion.signals import Spectrum as Spectrum
