"""Comparisons of models: error against run time, and quality under self-excitation. In: models. Out: tables."""

from femsub.studies.error_vs_time import (
    all_frequencies as all_frequencies,
    border_or_reason as border_or_reason,
    elastic as elastic,
)
from femsub.studies.friction_sweep import (
    FrictionRow as FrictionRow,
    compared as compared,
    first_loss as first_loss,
    over_mu as over_mu,
    same_loss as same_loss,
)
from femsub.studies.results import Row as Row, Study as Study
from femsub.studies.self_excitation import table_rows as table_rows
from femsub.studies.tables import fitted as fitted, table as table, yes_no as yes_no
