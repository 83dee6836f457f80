"""femsub: reduced substructures for friction-induced vibration, and whether the stability result survives them.

    scene ─► Substructure (sparse M, D, K, interface, ports)
                 │  reduce(sub, CraigBampton(modes=4))
                 ▼
             ReducedSubstructure (the same kind of object, dense)
                 ▼
             complex_modes │ sweep │ critical_slope        the same call for full and reduced
                 ▼
             study: error against run time

A name is imported when it is first used: a chain scene never loads what only a finite-element scene needs. No module
is called like a function of this page (`chains.py` holds `chain`), or the module would hide it once imported.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Pencil": "pencil",
    "Substructure": "substructure", "ReducedSubstructure": "substructure",
    "DofMap": "dofs", "Mesh": "meshes", "displacements": "fields", "read_mesh": "meshfiles", "write_mesh": "meshfiles",
    "block": "blocks", "annulus": "blocks", "rectangle": "blocks", "Material": "assembly", "solid": "solids",
    "read_component": "components", "write_matrices": "modelfiles", "read_matrix": "matrixfiles",
    "StribeckArctan": "friction", "StribeckArctanOdd": "friction", "Belt": "friction",
    "chain": "chains", "chain_frequencies": "chains",
    "beam": "beams", "plate": "plates", "damped": "dampers",
    "normal_modes": "eigen", "NormalModes": "eigen",
    "reduce": "bases", "CraigBampton": "bases", "CraigChang": "bases", "Estimate": "estimates",
    "complex_modes": "cea", "ComplexModes": "cea", "refine": "refinement", "Refined": "refinement",
    "harmonic_balance": "cycles", "LimitCycle": "cycles", "branch": "branches", "Branch": "branches",
    "shoot": "shooting", "ShotCycle": "shooting",
    "sweep": "stability", "critical_slope": "stability", "CriticalSlope": "stability", "StabilitySweep": "stability",
    "transient": "transients", "Transient": "transients", "State": "contacts",
    "spectrum": "spectra", "spectrogram": "spectra", "growth_rate": "spectra", "sticking": "spectra", "rms": "spectra",
    "study": "studies", "Study": "studyresults",
    "self_excitation": "quality", "SelfExcitation": "quality",
    "FemsubError": "errors", "InputError": "errors", "InputTypeError": "errors", "SingularMatrixError": "errors",
    "NotConvergedError": "errors", "MissedModesError": "errors", "UnstableModelError": "errors",
    "MissingPackageError": "errors", "NotEnoughMemoryError": "errors", "FemsubWarning": "errors", "PortWarning": "errors",
    "CutoffWarning": "errors",
    "ConditionWarning": "errors",
}

__all__ = sorted([*_HOME, "__version__"])

if TYPE_CHECKING:
    from femsub.assembly import Material
    from femsub.bases import CraigBampton, CraigChang, reduce
    from femsub.beams import beam
    from femsub.blocks import annulus, block, rectangle
    from femsub.branches import Branch, branch
    from femsub.cea import ComplexModes, complex_modes
    from femsub.chains import chain, chain_frequencies
    from femsub.components import read_component
    from femsub.contacts import State
    from femsub.cycles import LimitCycle, harmonic_balance
    from femsub.dampers import damped
    from femsub.dofs import DofMap
    from femsub.eigen import NormalModes, normal_modes
    from femsub.errors import (
        ConditionWarning,
        CutoffWarning,
        FemsubError,
        FemsubWarning,
        InputError,
        InputTypeError,
        MissedModesError,
        MissingPackageError,
        NotConvergedError,
        NotEnoughMemoryError,
        PortWarning,
        SingularMatrixError,
        UnstableModelError,
    )
    from femsub.estimates import Estimate
    from femsub.fields import displacements
    from femsub.friction import Belt, StribeckArctan, StribeckArctanOdd
    from femsub.matrixfiles import read_matrix
    from femsub.meshes import Mesh
    from femsub.meshfiles import read_mesh, write_mesh
    from femsub.modelfiles import write_matrices
    from femsub.pencil import Pencil
    from femsub.plates import plate
    from femsub.quality import SelfExcitation, self_excitation
    from femsub.refinement import Refined, refine
    from femsub.shooting import ShotCycle, shoot
    from femsub.solids import solid
    from femsub.spectra import growth_rate, rms, spectrogram, spectrum, sticking
    from femsub.stability import CriticalSlope, StabilitySweep, critical_slope, sweep
    from femsub.studies import study
    from femsub.studyresults import Study
    from femsub.substructure import ReducedSubstructure, Substructure
    from femsub.transients import Transient, transient


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'femsub' has no attribute {name!r}")
    value = getattr(import_module(f"femsub.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
