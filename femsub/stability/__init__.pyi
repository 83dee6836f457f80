from .changes_tried import WhatHelps as WhatHelps
from .critical_value import critical_slope as critical_slope, first_value as first_value
from .crossings import Crossing as Crossing
from .parameter import pencil_over as pencil_over
from .scatter import Scatter as Scatter
from .stability_map import StabilityMap as StabilityMap
from .tracking import Tracked as Tracked
