from .contact_modes import ContactModes as ContactModes
from .frequency_bounds import FrequencyBounds as FrequencyBounds
from .given_model import (
    AGREE as AGREE,
    HELD_KIND as HELD_KIND,
    PRODUCTS as PRODUCTS,
    SHAPED as SHAPED,
    Body as Body,
    GivenModel as GivenModel,
    Mapped as Mapped,
    coupling as coupling,
    dense as dense,
    off_diagonal as off_diagonal,
)
from .named import method_key as method_key, of_size as of_size, with_room as with_room
from .on_springs import errors_on_springs as errors_on_springs, interface_stiffness as interface_stiffness
from .parameter_box import BoxModel as BoxModel, ParameterBox as ParameterBox
from .reduce import METHODS as METHODS, PORT_LIMIT as PORT_LIMIT, Method as Method
from .reductor import Reductor as Reductor
from .steps import (
    Bases as Bases,
    Step as Step,
    in_words as in_words,
    kept_modes as kept_modes,
    key_of as key_of,
    methods_of as methods_of,
    port_error as port_error,
    reduced_by as reduced_by,
    step_name as step_name,
    twins as twins,
)
