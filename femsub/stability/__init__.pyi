from .parameter import pencil_over as pencil_over
from .seen_losses import losses_over as losses_over
from .tracking import Tracked as Tracked
