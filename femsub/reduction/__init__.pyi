from .contact_modes import ContactModes as ContactModes
from .reduce import METHODS as METHODS, PORT_LIMIT as PORT_LIMIT, Method as Method
from .reductor import Reductor as Reductor
