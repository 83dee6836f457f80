"""Where friction takes the stability away. In: a model and a port. Out: the critical slope, and growth rates over the slope."""

from femsub.stability.seen_losses import losses_over as losses_over
from femsub.stability.tracking import Tracked as Tracked
