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

The imports below list what is public. Type checkers follow them, and take a name for public where it is written twice, as in
`chain as chain`. At run time a name is imported when it is first used: a chain scene never loads what only a finite-element scene
needs. The folders are rooms in the order of the method; imports go to rooms before (tests/test_house.py).
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
    from femsub.components.beam import beam as beam
    from femsub.components.chain import chain as chain, chain_frequencies as chain_frequencies
    from femsub.components.fields import displacements as displacements
    from femsub.components.grids import annulus as annulus, block as block, rectangle as rectangle
    from femsub.components.mesh import Mesh as Mesh
    from femsub.components.plate import plate as plate
    from femsub.components.solid import solid as solid
    from femsub.components.solid_assembly import Material as Material
    from femsub.coupling.assembly import System as System, couple as couple
    from femsub.coupling.contacts.belt import (
        Belt as Belt,
        StribeckArctan as StribeckArctan,
        StribeckArctanOdd as StribeckArctanOdd,
    )
    from femsub.coupling.contacts.friction_contact import FrictionContact as FrictionContact
    from femsub.coupling.cutting import Cut as Cut, cut as cut
    from femsub.coupling.joints import Rigid as Rigid, Spring as Spring
    from femsub.coupling.rigid_links import Averaged as Averaged, Kinematic as Kinematic
    from femsub.coupling.ties import Tied as Tied
    from femsub.errors import (
        ConditionWarning as ConditionWarning,
        CutoffWarning as CutoffWarning,
        FemsubError as FemsubError,
        FemsubWarning as FemsubWarning,
        InputError as InputError,
        InputTypeError as InputTypeError,
        MissedModesError as MissedModesError,
        MissingPackageError as MissingPackageError,
        NotConvergedError as NotConvergedError,
        NotEnoughMemoryError as NotEnoughMemoryError,
        PortWarning as PortWarning,
        SingularMatrixError as SingularMatrixError,
        UnstableModelError as UnstableModelError,
        WorkerError as WorkerError,
    )
    from femsub.io.component_files import read_component as read_component
    from femsub.io.matrix_files import read_matrix as read_matrix
    from femsub.io.mesh_files import read_mesh as read_mesh, write_mesh as write_mesh
    from femsub.io.model_folder import write_matrices as write_matrices
    from femsub.model.affine import Affine as Affine
    from femsub.model.contact import LinearContact as LinearContact
    from femsub.model.dof_map import DofMap as DofMap
    from femsub.model.estimate import Estimate as Estimate
    from femsub.model.pencil import Pencil as Pencil
    from femsub.model.substructure import ReducedSubstructure as ReducedSubstructure, Substructure as Substructure
    from femsub.modes.damping import damped as damped
    from femsub.modes.normal_modes import NormalModes as NormalModes, normal_modes as normal_modes
    from femsub.modes.quadratic.complex_modes import ComplexModes as ComplexModes, complex_modes as complex_modes
    from femsub.modes.quadratic.refinement import Refined as Refined, refine as refine
    from femsub.modes.rotation import Rotor as Rotor, rotating as rotating
    from femsub.motion.cycles.branch import Branch as Branch, branch as branch
    from femsub.motion.cycles.limit_cycle import LimitCycle as LimitCycle, harmonic_balance as harmonic_balance
    from femsub.motion.cycles.shooting import ShotCycle as ShotCycle, shoot as shoot
    from femsub.motion.nonlinear_model import State as State
    from femsub.motion.signals import (
        growth_rate as growth_rate,
        rms as rms,
        spectrogram as spectrogram,
        spectrum as spectrum,
        sticking as sticking,
    )
    from femsub.motion.transient import Transient as Transient, transient as transient
    from femsub.reduction.reduce import (
        ContactModes as ContactModes,
        CraigBampton as CraigBampton,
        CraigChang as CraigChang,
        CraigChangPhysical as CraigChangPhysical,
        DualCraigBampton as DualCraigBampton,
        Guyan as Guyan,
        Herting as Herting,
        Hurty as Hurty,
        InterfaceModes as InterfaceModes,
        MacNeal as MacNeal,
        Rubin as Rubin,
        reduce as reduce,
    )
    from femsub.reduction.system_estimate import system_estimate as system_estimate
    from femsub.stability.critical_slope import (
        CriticalSlope as CriticalSlope,
        StabilitySweep as StabilitySweep,
        critical_slope as critical_slope,
        sweep as sweep,
    )
    from femsub.stability.critical_value import CriticalValue as CriticalValue, critical_value as critical_value
    from femsub.stability.tracking import Tracked as Tracked, track as track
    from femsub.studies.error_vs_time import study as study
    from femsub.studies.results import Study as Study
    from femsub.studies.self_excitation import SelfExcitation as SelfExcitation, self_excitation as self_excitation

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
