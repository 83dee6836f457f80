from .contact_modes import ContactModes as ContactModes
from .frequency_bounds import FrequencyBounds as FrequencyBounds
from .named import method_key as method_key, of_size as of_size, with_room as with_room
from .on_springs import errors_on_springs as errors_on_springs, interface_stiffness as interface_stiffness
from .parameter_box import BoxModel as BoxModel, ParameterBox as ParameterBox
from .reduce import METHODS as METHODS, PORT_LIMIT as PORT_LIMIT, Method as Method
from .reductor import Reductor as Reductor
