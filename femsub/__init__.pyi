__version__: str
__all__: list[str]

from . import (
    algebra as algebra,
    components as components,
    coupling as coupling,
    io as io,
    modes as modes,
    motion as motion,
    output as output,
    reduction as reduction,
)
from .app.grammar import Scene as Scene
from .checks import (
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
from .components.beam import beam as beam, space_beam as space_beam
from .components.chain import chain as chain, chain_frequencies as chain_frequencies
from .components.facing import Facing as Facing, facing as facing
from .components.fields import displacements as displacements
from .components.grids import annulus as annulus, block as block, rectangle as rectangle
from .components.material_change import MaterialChange as MaterialChange
from .components.mesh import Mesh as Mesh
from .components.plate import plate as plate
from .components.small_models import node as node
from .components.solid import solid as solid
from .components.solid_assembly import Material as Material
from .coupling.assembly import System as System, couple as couple
from .coupling.contacts.belt import Belt as Belt, StribeckArctan as StribeckArctan, StribeckArctanOdd as StribeckArctanOdd
from .coupling.contacts.friction_contact import FrictionContact as FrictionContact
from .coupling.cutting import Cut as Cut, cut as cut
from .coupling.joints import Rigid as Rigid, Spring as Spring
from .coupling.rigid_links import Averaged as Averaged, Kinematic as Kinematic
from .coupling.ties import Tied as Tied
from .io.component_files import read_component as read_component
from .io.matrix_files import read_matrix as read_matrix
from .io.measurements import read_modes as read_modes, read_response as read_response
from .io.mesh_files import read_mesh as read_mesh, write_mesh as write_mesh
from .io.model_folder import write_matrices as write_matrices
from .io.pieces import cut_to_files as cut_to_files
from .io.superelement_files import write_superelement as write_superelement
from .model.affine import Affine as Affine
from .model.changes import (
    AddedDamper as AddedDamper,
    AddedMass as AddedMass,
    AddedSpring as AddedSpring,
    JointChange as JointChange,
)
from .model.contact import LinearContact as LinearContact
from .model.dof_map import DofMap as DofMap
from .model.estimate import Estimate as Estimate
from .model.families import family_of as family_of
from .model.pencil import Pencil as Pencil
from .model.substructure import ReducedSubstructure as ReducedSubstructure, Substructure as Substructure
from .modes.damping import damped as damped, equivalent_viscous as equivalent_viscous
from .modes.frequency_substructuring import couple_responses as couple_responses, virtual_point as virtual_point
from .modes.mode_cards import ModeCard as ModeCard, mode_cards as mode_cards
from .modes.mode_names import ModeName as ModeName, mode_names as mode_names
from .modes.mode_set import ModeSet as ModeSet
from .modes.normal_modes import NormalModes as NormalModes, normal_modes as normal_modes
from .modes.participation import EffectiveMasses as EffectiveMasses, effective_masses as effective_masses
from .modes.quadratic.complex_modes import ComplexModes as ComplexModes, complex_modes as complex_modes
from .modes.quadratic.refinement import Refined as Refined, refine as refine
from .modes.receptance import FrequencyResponse as FrequencyResponse, frequency_response as frequency_response
from .modes.rotation import Rotor as Rotor, rotating as rotating
from .motion.cycles.branch import Branch as Branch, branch as branch
from .motion.cycles.limit_cycle import LimitCycle as LimitCycle, harmonic_balance as harmonic_balance
from .motion.cycles.shooting import ShotCycle as ShotCycle, shoot as shoot
from .motion.nonlinear_model import State as State
from .motion.self_excitation import SelfExcitation as SelfExcitation, self_excitation as self_excitation
from .motion.signals import (
    growth_rate as growth_rate,
    rms as rms,
    spectrogram as spectrogram,
    spectrum as spectrum,
)
from .motion.transient import Transient as Transient, sticking as sticking, transient as transient
from .reduction.estimates.joined import system_estimate as system_estimate
from .reduction.frequency_bounds import FrequencyBounds as FrequencyBounds, frequency_bounds as frequency_bounds
from .reduction.levels import Levels as Levels, reduce_by_levels as reduce_by_levels
from .reduction.parameter_box import BoxModel as BoxModel, Cell as Cell, ParameterBox as ParameterBox
from .reduction.reduce import (
    ContactModes as ContactModes,
    CraigBampton as CraigBampton,
    CraigChang as CraigChang,
    DualCraigBampton as DualCraigBampton,
    Guyan as Guyan,
    Herting as Herting,
    Hurty as Hurty,
    InterfaceModes as InterfaceModes,
    MacNeal as MacNeal,
    Rubin as Rubin,
    reduce as reduce,
)
from .stability.changes_tried import WhatHelps as WhatHelps, modified as modified, what_helps as what_helps
from .stability.critical_value import critical_slope as critical_slope, critical_value as critical_value
from .stability.question import CriticalValue as CriticalValue
from .stability.scatter import Scatter as Scatter, scatter as scatter
from .stability.sensitivities import Sensitivities as Sensitivities, sensitivities as sensitivities
from .stability.stability_map import StabilityMap as StabilityMap, stability_map as stability_map
from .stability.sweep import StabilitySweep as StabilitySweep, sweep as sweep
from .stability.tracking import Tracked as Tracked, track as track
from .studies.audit import Audit as Audit, audit as audit
from .studies.error_vs_time import study as study
from .studies.results import Study as Study
