from .abaqus_calculix import read_dofs as read_dofs
from .atomic import (
    HASHES as HASHES,
    Writer as Writer,
    content_sum as content_sum,
    held as held,
    newest as newest,
    remove as remove,
    with_index as with_index,
    write_or_refuse as write_or_refuse,
)
from .component_files import (
    read_aligned as read_aligned,
    refuse_exchanged as refuse_exchanged,
)
from .damage import existing as existing
from .declared import (
    Key as Key,
    alternatives as alternatives,
    check_value as check_value,
    item_type as item_type,
    key as key,
    keys_of as keys_of,
    read_table as read_table,
    spelt as spelt,
    type_words as type_words,
)
from .described import (
    any_of as any_of,
    docstring_lines as docstring_lines,
    first_line as first_line,
    listed_keys as listed_keys,
    table_schema as table_schema,
)
from .faults import Faults as Faults, Place as Place
from .matrix_files import read_arrays as read_arrays
from .mesh_files import mesh_bytes as mesh_bytes, mesh_writer as mesh_writer, read_mesh as read_mesh, series_bytes as series_bytes
from .mesh_text import including as including, texts_read as texts_read
from .mode_files import (
    mode_file as mode_file,
    motion_files as motion_files,
    moving as moving,
    read_mode as read_mode,
)
from .model_folder import FORMATS as FORMATS, model_files as model_files
from .results_file import RESULTS as RESULTS, results_of as results_of
from .toml_files import line_numbers as line_numbers, parsed_toml as parsed_toml, toml as toml, toml_text as toml_text
