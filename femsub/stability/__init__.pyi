from .parameter import pencil_over as pencil_over
from .tracking import Tracked as Tracked
