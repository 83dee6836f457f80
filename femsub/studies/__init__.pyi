from .charts_errors import (
    error_time_chart as error_time_chart,
    errors_chart as errors_chart,
    friction_errors_chart as friction_errors_chart,
    period_chart as period_chart,
)
from .charts_models import (
    critical_chart as critical_chart,
    friction_chart as friction_chart,
    growth_chart as growth_chart,
    springs_chart as springs_chart,
)
from .error_vs_time import (
    all_frequencies as all_frequencies,
    elastic as elastic,
    in_words as in_words,
    key_of as key_of,
    reduced_by as reduced_by,
)
from .results import Row as Row, Study as Study
from .self_excitation import table_rows as table_rows
from .verdicts import (
    ANSWERS as ANSWERS,
    NEVER as NEVER,
    Advice as Advice,
    Remark as Remark,
    Verdict as Verdict,
    answer as answer,
    cycles_verdict as cycles_verdict,
    named as named,
    sentence as sentence,
    stability_remark as stability_remark,
    study_choice as study_choice,
)
