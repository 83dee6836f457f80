from .charts import (
    ROUNDING as ROUNDING,
    Chart as Chart,
    Panel as Panel,
    Series as Series,
)
from .charts_changes import changes_chart as changes_chart
from .charts_components import (
    critical_chart as critical_chart,
    eigenvalue_chart as eigenvalue_chart,
    friction_chart as friction_chart,
    growth_chart as growth_chart,
    response_chart as response_chart,
    springs_chart as springs_chart,
)
from .charts_errors import (
    error_time_chart as error_time_chart,
    errors_chart as errors_chart,
    friction_errors_chart as friction_errors_chart,
)
from .charts_flutter import flutter_chart as flutter_chart
from .charts_map import stability_map_chart as stability_map_chart, stability_map_tables as stability_map_tables
from .charts_motion import (
    bifurcation_chart as bifurcation_chart,
    period_chart as period_chart,
    signals_chart as signals_chart,
    spectra_chart as spectra_chart,
    spectrogram_chart as spectrogram_chart,
)
from .charts_scatter import scatter_chart as scatter_chart, scatter_tables as scatter_tables
from .error_vs_time import (
    all_frequencies as all_frequencies,
    elastic as elastic,
    in_words as in_words,
    key_of as key_of,
    reduced_by as reduced_by,
)
from .losses import Loss as Loss, first_loss as first_loss, with_value as with_value
from .results import Row as Row, Study as Study
from .self_excitation import table_rows as table_rows
from .tables import (
    Table as Table,
    column as column,
    fitted as fitted,
    label as label,
    look as look,
    span as span,
    table as table,
)
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
