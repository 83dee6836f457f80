from .charts_errors import (
    error_time_chart as error_time_chart,
    study_chart as study_chart,
)
from .results import Row as Row, Study as Study
