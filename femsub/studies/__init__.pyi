from .charts import (
    ROUNDING as ROUNDING,
    Chart as Chart,
    Level as Level,
    Panel as Panel,
    Series as Series,
    floored as floored,
    look as look,
)
from .error_vs_time import all_frequencies as all_frequencies, elastic as elastic
from .losses import Loss as Loss, affine_over as affine_over, first_loss as first_loss
from .results import Row as Row, Study as Study
from .self_excitation import table_rows as table_rows
from .tables import (
    Column as Column,
    Table as Table,
    column as column,
    fitted as fitted,
    label as label,
    table as table,
    yes_no as yes_no,
)
from .verdicts import (
    NEVER as NEVER,
    Choice as Choice,
    Remark as Remark,
    Verdict as Verdict,
    answer as answer,
    cycles_verdict as cycles_verdict,
    named as named,
    sentence as sentence,
    stability_remark as stability_remark,
    study_choice as study_choice,
)
