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

The imports below list what is public. Type checkers follow them; at run time a name is imported when it is first used: a chain
scene never loads what only a finite-element scene needs. The folders are rooms in the order of the method; imports go to rooms
before (tests/test_house.py).
"""

from __future__ import annotations

import ast
import logging
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# what is factorised, solved and counted, for whoever listens: logging.getLogger("femsub"), levels INFO and DEBUG
logging.getLogger("femsub").addHandler(logging.NullHandler())

if TYPE_CHECKING:
    from femsub.components.beam import beam
    from femsub.components.chain import chain, chain_frequencies
    from femsub.components.damping import damped
    from femsub.components.fields import displacements
    from femsub.components.grids import annulus, block, rectangle
    from femsub.components.mesh import Mesh
    from femsub.components.plate import plate
    from femsub.components.solid import solid
    from femsub.components.solid_assembly import Material
    from femsub.components.ties import Tied
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
    from femsub.io.component_files import read_component
    from femsub.io.matrix_files import read_matrix
    from femsub.io.mesh_files import read_mesh, write_mesh
    from femsub.io.model_folder import write_matrices
    from femsub.model.assembly import System, couple
    from femsub.model.dof_map import DofMap
    from femsub.model.estimate import Estimate
    from femsub.model.friction import Belt, StribeckArctan, StribeckArctanOdd
    from femsub.model.joints import Rigid, Spring
    from femsub.model.pencil import Pencil
    from femsub.model.rigid_links import Averaged, Kinematic
    from femsub.model.substructure import ReducedSubstructure, Substructure
    from femsub.modes.normal_modes import NormalModes, normal_modes
    from femsub.motion.cycles.branch import Branch, branch
    from femsub.motion.cycles.limit_cycle import LimitCycle, harmonic_balance
    from femsub.motion.cycles.shooting import ShotCycle, shoot
    from femsub.motion.nonlinear_model import State
    from femsub.motion.signals import growth_rate, rms, spectrogram, spectrum, sticking
    from femsub.motion.transient import Transient, transient
    from femsub.quadratic.complex_modes import ComplexModes, complex_modes
    from femsub.quadratic.refinement import Refined, refine
    from femsub.reduction.reduce import (
        CraigBampton,
        CraigChang,
        CraigChangPhysical,
        DualCraigBampton,
        Guyan,
        Herting,
        Hurty,
        MacNeal,
        Rubin,
        reduce,
    )
    from femsub.stability.critical_slope import CriticalSlope, StabilitySweep, critical_slope, sweep
    from femsub.studies.error_vs_time import study
    from femsub.studies.results import Study
    from femsub.studies.self_excitation import SelfExcitation, self_excitation

#: name: the module that it comes from, as the imports above say
_HOME = {alias.name: node.module for node in ast.walk(ast.parse(Path(__file__).read_text(encoding="utf-8")))
         if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("femsub.") for alias in node.names}

__all__ = sorted([*_HOME, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'femsub' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
