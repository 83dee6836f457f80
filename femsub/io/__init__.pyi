from .abaqus_calculix import read_dofs as read_dofs
from .atomic import (
    HASHES as HASHES,
    Writer as Writer,
    content_sum as content_sum,
    held as held,
    newest as newest,
    remove as remove,
    with_index as with_index,
    write_whole as write_whole,
)
from .component_files import read_aligned as read_aligned
from .matrix_files import read_arrays as read_arrays
from .mesh_files import mesh_bytes as mesh_bytes, read_mesh as read_mesh, series_bytes as series_bytes
from .mesh_text import including as including, texts_read as texts_read
from .model_folder import FORMATS as FORMATS, model_files as model_files
