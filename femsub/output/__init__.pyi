from .charts import (
    ROUNDING as ROUNDING,
    STYLES as STYLES,
    Chart as Chart,
    Heat as Heat,
    Level as Level,
    Panel as Panel,
    Series as Series,
    damping_percent as damping_percent,
    finite as finite,
    floored as floored,
    hover_of as hover_of,
    linear_up_to as linear_up_to,
    nested as nested,
)
from .displayed import Displayed as Displayed, picture as picture, units_of as units_of
from .figures import (
    HERTZ as HERTZ,
    MANY as MANY,
    PAGE as PAGE,
    SIZES as SIZES,
    STYLE as STYLE,
    draw as draw,
    draw_panel as draw_panel,
    few_decades as few_decades,
    figure_of as figure_of,
    label_points as label_points,
    legend_below as legend_below,
    new_figure as new_figure,
    render as render,
)
from .files import for_json as for_json, table_csv as table_csv, to_json as to_json
from .page import MODE_FILE as MODE_FILE, Moving as Moving, check_plotly as check_plotly, write_page as write_page
from .result import Picture as Picture, Result as Result, Shown as Shown
from .tables import (
    KNOWN as KNOWN,
    LOOKS as LOOKS,
    WIDTH as WIDTH,
    Column as Column,
    Look as Look,
    Table as Table,
    column as column,
    fitted as fitted,
    grouped as grouped,
    label as label,
    look as look,
    span as span,
    table as table,
)
from .units import (
    DENSEST as DENSEST,
    FASTEST as FASTEST,
    IN_SI as IN_SI,
    SYSTEMS as SYSTEMS,
    UNKNOWN as UNKNOWN,
    Units as Units,
    factor_words as factor_words,
)
from .verdicts import (
    ANSWERS as ANSWERS,
    NEVER as NEVER,
    STABLE as STABLE,
    Advice as Advice,
    Remark as Remark,
    Verdict as Verdict,
    answer as answer,
    named as named,
    sentence as sentence,
)
