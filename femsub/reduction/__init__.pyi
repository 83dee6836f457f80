from .contact_modes import ContactModes as ContactModes
from .frequency_bounds import FrequencyBounds as FrequencyBounds, frequency_bounds as frequency_bounds
from .reduce import METHODS as METHODS, PORT_LIMIT as PORT_LIMIT, Guyan as Guyan, Method as Method, reduce as reduce
from .reductor import Reductor as Reductor
