"""femsub: reduced substructures for friction-induced vibration, and whether the stability result survives them.

    scene ─► Substructure (sparse M, D, K, interface, ports)
                 │  reduce(sub, CraigBampton(modes=4))
                 ▼
             ReducedSubstructure (the same kind of object, dense)
                 │  couple({"disc": ..., "pad": ...}, joints)
                 ▼
             System (the same kind of object again)
                 ▼
             complex_modes │ sweep │ critical_slope        the same call for full and reduced
                 ▼
             study: error against run time

`__init__.pyi` lists what is public. A name is imported when it is first used: a chain scene never loads what only a
finite-element scene needs. The folders are rooms in the order of the method; imports go to rooms before (tests/test_house.py).
"""

import logging
from os import listdir

try:
    import lazy_loader
except ModuleNotFoundError:
    from importlib.util import find_spec

    from femsub.checks import MissingPackageError, installed_by

    _lacking = [name for name in ("numpy", "scipy", "lazy_loader", "threadpoolctl") if find_spec(name) is None]
    raise MissingPackageError(f"femsub needs {', '.join(_lacking)}: {installed_by(*_lacking)}") from None

__version__ = "0.1.0"

# the logger "femsub" reports factorisations, solves and counts at INFO and DEBUG; it is silent until a user adds a handler
logging.getLogger("femsub").addHandler(logging.NullHandler())

__getattr__, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
# the rooms are attributes too, such as `fs.coupling`, but they are no names of the front door
__all__ = sorted({*_names, "__version__"} - set(listdir(__path__[0])))
