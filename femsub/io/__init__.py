"""Files of matrices, meshes and models. Every file is checked when it is read, and written completely or not at all.

In: a path. Out: matrices, a `Mesh` or a `Substructure`; and the reverse for writing.
"""

from femsub.io.atomic import (
    HASHES as HASHES,
    OURS as OURS,
    Writer as Writer,
    content_hash as content_hash,
    hashed as hashed,
    held as held,
    newest as newest,
    write_whole as write_whole,
)
from femsub.io.component_files import read_aligned as read_aligned
from femsub.io.matrix_files import read_arrays as read_arrays
from femsub.io.mesh_files import mesh_bytes as mesh_bytes, read_mesh as read_mesh, series_bytes as series_bytes
from femsub.io.mesh_text import including as including, texts_read as texts_read
from femsub.io.model_folder import FORMATS as FORMATS
