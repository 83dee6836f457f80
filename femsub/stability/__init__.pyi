from .changes_tried import WhatHelps as WhatHelps
from .charts import critical_chart as critical_chart, growth_chart as growth_chart
from .critical_value import critical_slope as critical_slope, first_value as first_value
from .crossings import Crossing as Crossing, fixed_digits as fixed_digits
from .flutter_chart import flutter_chart as flutter_chart
from .losses import (
    Loss as Loss,
    all_losses as all_losses,
    first_belt as first_belt,
    first_loss as first_loss,
    outcome as outcome,
    with_value as with_value,
)
from .map_chart import stability_map_chart as stability_map_chart, stability_map_tables as stability_map_tables
from .parameter import pencil_over as pencil_over
from .scatter import Scatter as Scatter
from .stability_map import StabilityMap as StabilityMap
from .tracking import Tracked as Tracked
