"""Scene files: what may stand in one, checked to the last key before anything is computed."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeAlias

from femsub import coupling, reduction, studies
from femsub.app.keys import check_keys, key, keys_of, values_of
from femsub.app.units import SYSTEMS, UNKNOWN, Units
from femsub.checks import Interruptible, choice, resolved, shown, word
from femsub.errors import FemsubError, InputError, unknown_name
from femsub.io import Writer

Progress = Callable[[str], None]


class Picture(NamedTuple):
    """A figure: the name of its file, without ending, and a function that draws it onto a new matplotlib figure."""

    name: str
    draw: Callable[[], Any]


Shown: TypeAlias = Any  # str, Table, Chart or Picture

#: name of a built-in scene: (module of femsub.app.scenes and class in it, one line)
SCENES = {
    "chain": ("chain:ChainScene", "the paper's chain on a belt: full and reduced, its figures 2 to 4, error against run time"),
    "matrices": ("matrices:MatricesScene", "your own M, D, K from files: reduced models, critical slope, error against time"),
    "beam": ("beam:BeamScene", "a steel beam on a belt: modes, critical slope, eigenvalues, error against run time"),
    "plate": ("plate:PlateScene", "a thin plate, made or from a mesh file: the same, with pictures and VTU files of shapes"),
    "solid": ("solid:SolidScene", "a solid, a brake's disc or your own mesh: the same"),
    "frequency-response": ("beam:FrequencyResponseScene",
                           "a beam driven at its contact: receptances, full and reduced, with bounds"),
    "chain-parts": ("joined_parts:ChainPartsScene",
                    "the chain cut into 2, 3 and 5 parts, each reduced by every method, and joined again"),
    "plate-parts": ("joined_parts:PlatePartsScene",
                    "a plate cut into 8 parts: methods compared, and how many modes each part needs"),
    "solid-parts": ("solid_parts:SolidPartsScene", "8 solids, bolted and glued, whose meshes do not match: the same"),
    "own-parts": ("own_parts:OwnPartsScene", "your own parts, from matrices and meshes, joined: methods compared part by part"),
    "superelements": ("own_parts:SuperelementsScene",
                      "superelements of other programs, joined: checked, frequencies, reduced further"),
    "brake": ("brake:BrakeScene", "a disc brake: flutter by friction over μ, full and reduced by several methods"),
    "chain-transient": ("in_time:ChainTransientScene", "the chain in time: full and reduced, spectrograms (Fig. 5)"),
    "solid-transient": ("in_time:SolidTransientScene", "a disc in time: limit cycle, full against reduced, time per period"),
    "chain-limit-cycle": ("cycles:ChainCycleScene", "the chain's limit cycles, full and reduced: table, branches, stability"),
    "plate-limit-cycle": ("cycles:PlateCycleScene", "the plate's limit cycles over the normal force: full and reduced"),
    "two-mode": ("flutter:TwoModeScene", "two modes coupled by friction (Hoffmann): critical friction, flutter diagram"),
    "affine": ("affine:AffineScene", "your own matrices with factors of named parameters: critical value, flutter diagram"),
    "ziegler": ("flutter:ZieglerScene", "Ziegler's pendulum under a follower load: what damping destabilises, flutter diagram"),
    "audit": ("audit:AuditScene", "anybody's reduced model from files: what is right, wrong, and cannot be known"),
}
OWN = ".py"  #: ending of a file with a scene of your own
LONGEST_NAME = 100
PAGE = "page"  # the output that is made of the others
#: of the literature, and of Python's MacNeal
SHORT_NAMES = {"hcb": "craig-bampton", "cc": "craig-chang", "dcb": "dual-craig-bampton", "mac-neal": "macneal"}
#: Keys that scenes of nonlinear models do not have.
NO_SLOPE = {"slope": "the nonlinear model needs a friction law, i.e. law, eps and speed, not a slope"}


def first_of(names: Sequence[str], kind: str = "", most: int = 5) -> str:
    """'a, b, c, d, e and 2 more', so that a sentence stays one; `kind` is what they are."""
    more = f" and {len(names) - most} more {kind}".rstrip() if len(names) > most else ""
    return ", ".join(names[:most]) + more


def behind(words: str, progress: Progress) -> Progress:
    """Reports each step behind these words."""
    return lambda text: progress(f"{words}{text}")


def method_keys(_: object) -> Iterable[str]:
    return sorted(reduction.METHODS)


def other_method_names() -> list[str]:
    return [*(name.upper() for name in SHORT_NAMES if "-" not in name),
            *sorted(method.__name__ for method in reduction.METHODS.values())]


@dataclass(frozen=True)
class Scene:
    """What all scenes share. `femsub keys SCENE` lists a scene's keys; each is explained where its field is declared."""

    name: str = key("", "for headings and file names", otherwise="the scene's name")
    slope: float | None = key(None, "μ'(v0), the slope of the friction law over the sliding speed; it replaces law, eps, speed",
                              unit="time/length", otherwise="the slope of law at speed", example=-0.2677)
    law: str = key("stribeck-arctan", "the friction law: as the paper prints it, odd, or one of your own in LAWS",
                   choices=lambda _: coupling.LAWS)
    eps: float = key(1e-3, "the friction law's width ε around speed 0", unit="length/time", above=0)
    speed: float = key(0.19113, "the belt's speed v0", unit="length/time")
    force: float = key(1.0, "the normal force with which the belt presses", unit="force", least=0)
    methods: list[str] = key(["craig-bampton", "craig-chang"], "reduction methods; short names (HCB, CC) and those of the Python "
                             "classes will do", choices=method_keys, also=other_method_names)
    outputs: list[str] = key([], "what is computed, nothing else is; with 'page' the results are also one page to read, "
                             "report.html in the folder given by --out; 'page' alone: all of the default, and the page",
                             choices=lambda scene: (*scene.OUTPUTS, *scene.ON_REQUEST, PAGE))
    figures: bool = key(True, "whether figures are drawn, in the folder given by --out")
    repeats: int = key(5, "runs per time that is measured", least=1, most=1000)
    units: str = key("", "the units of all numbers: 'SI' (m, kg, s, N) or 'mm-t-s' (mm, t, s, N); with them Hz stands beside "
                     "rad/s in what is printed, written and drawn; nothing is converted", choices=lambda _: SYSTEMS,
                     otherwise="no unit is claimed", example="SI")

    own: str = ""  #: the Python file of a scene of your own
    folder: str = "."  #: where the files are that it names

    OUTPUTS: ClassVar[tuple[str, ...]] = ()
    ON_REQUEST: ClassVar[tuple[str, ...]] = ()
    WITHOUT: ClassVar[Mapping[str, str]] = {}  #: keys that a scene does not have, and why
    PAPER: ClassVar[Mapping[str, str]] = {}  #: figures of the paper, by ours that correspond to them

    def __post_init__(self) -> None:
        if not set(self.outputs) - {PAGE}:
            self.put(outputs=[*self.OUTPUTS, *self.outputs])
        self.put(methods=[_known(name, reduction.METHODS) for name in self.methods], law=_known(self.law, coupling.LAWS))
        check_keys(self)
        highest = sys.float_info.max**(1 / 3)
        if max(getattr(self, "band", None) or [0.0]) > highest:
            raise InputError(f"band must end below {highest:.3g}, so that the cubes of its frequencies are finite; it is "
                             f"{shown(self.band)}")  # type: ignore[attr-defined]

    def run(self, progress: Progress) -> Result:
        """Computes what `outputs` names, and nothing else."""
        raise NotImplementedError

    def put(self, **values: Any) -> None:
        """Sets keys while the scene is made."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def fill(self, **values: Any) -> None:
        """Sets those keys that were left out."""
        self.put(**{name: value for name, value in values.items() if not getattr(self, name)})

    @property
    def paged(self) -> bool:
        """Whether a page is asked for, and with it the shape of a mode for it."""
        return PAGE in self.outputs

    @property
    def system(self) -> Units:
        """The units that `units` names."""
        return SYSTEMS.get(self.units, UNKNOWN)

    @property
    def labels(self) -> str:
        """The methods' names in tables: 'Craig-Bampton and Craig-Chang'."""
        return " and ".join(reduction.METHODS[key].label for key in self.methods)

    @property
    def rubbing(self) -> coupling.Belt:
        """The belt with its law.

        Raises
        ------
        InputError
            There is a slope instead of a law.
        """
        if self.slope is not None:
            raise InputError(f"scene key 'slope': {NO_SLOPE['slope']}")
        return coupling.Belt(force=self.force, speed=self.speed, law=coupling.LAWS[self.law](eps=self.eps))

    @property
    def linear_belt(self) -> coupling.Belt:
        """The belt with its slope alone, given or from the law."""
        return coupling.Belt(force=self.force, slope=self.rubbing.slope if self.slope is None else self.slope)

    @property
    def friction(self) -> dict[str, Any]:
        """What stands of the friction in results.json."""
        return {"force": self.force, "slope": self.linear_belt.slope, "law": self.law if self.slope is None else None,
                "eps": self.eps, "speed": self.speed}

    @property
    def friction_words(self) -> str:
        """The friction in the first lines of what is printed."""
        slope = self.linear_belt.slope
        if self.slope is not None:
            return f"F = {self.force:g}, slope {slope:.6g}"
        return f"F = {self.force:g}, {self.law}, ε = {self.eps:g}, v0 = {self.speed:g}: μ' = {slope:.6g}"


@dataclass(frozen=True)
class Result:
    """What a scene has computed, ready to be shown.

    Attributes
    ----------
    data : dict
        Everything printed or drawn, for results.json.
    shown : sequence of str, Table, Chart or Picture
        What is shown, in this order: sentences; tables, which are printed and have a CSV file each if they have rows; charts
        and pictures, each a PNG file. A page has tables and charts.
    files : dict of str to callable
        File name, which may name a folder below that of the results, to a function that writes the file's content. Called
        only where there is a folder to write to.
    head : sequence
        The first of `shown`, which say what the model is.
    """

    data: dict[str, Any]
    shown: Sequence[Shown] = ()
    files: dict[str, Writer] = field(default_factory=dict)
    head: Sequence[Shown] = ()

    @property
    def tables(self) -> dict[str, studies.Table]:
        """Those with rows by the names of their files."""
        return {one.name: one for one in self.shown if isinstance(one, studies.Table) and one.name and one.rows}

    @property
    def drawings(self) -> dict[str, Callable[[], Any]]:
        """File names (without ending) to functions that draw onto a new matplotlib figure."""
        from femsub.app.figure_style import draw

        return {chart.name: partial(draw, chart) for chart in self.charts if chart.drawn} | {
            one.name: one.draw for one in self.shown if isinstance(one, Picture)}

    @property
    def charts(self) -> list[studies.Chart]:
        """Those for a page."""
        return [one for one in self.shown if isinstance(one, studies.Chart)]

    def text(self, units: Units = UNKNOWN) -> str:
        """All sentences and tables."""
        return units.said("\n".join(one if isinstance(one, str) else one.text(units.known) for one in self.shown
                                    if isinstance(one, str) or (isinstance(one, studies.Table) and one.columns)))

    def printed(self, units: Units = UNKNOWN, whole: bool = False) -> str:
        """The verdict, then the short table of each comparison, or, with `whole` or where nothing was compared, all tables."""
        verdict = studies.answer(self.shown)
        choices = [one for one in self.shown if isinstance(one, studies.Advice)]
        parts = [verdict.text] if verdict.decided else []
        if whole or not choices:
            parts.append(self.text(units))
        else:
            parts.append(Result({}, self.head).text(units))
            parts += [f"{one.where.capitalize()}\n{one.brief}" if one.where else one.brief for one in choices]
        decides = verdict.decides if whole or not choices else [
            line for one in self.shown if isinstance(one, studies.Remark) for line in one.decides
            if one not in choices or line.startswith("Mind")]
        if not whole:  # where no model will do, its sentence says what to do
            decides = [*(studies.sentence(one.sentence, one.where) for one in choices if not one.model), *decides]
        lists = [("What decides it", decides), ("Not checked", verdict.unchecked if whole else ())]
        parts += ["\n".join([f"{title}:", *(f"- {line}" for line in dict.fromkeys(lines))]) for title, lines in lists if lines]
        if choices and not whole:
            parts.append(f"All tables ({len(self.tables)}): -v prints them, --out DIR writes them.")
        return units.said("\n\n".join(filter(None, parts)))


@dataclass(eq=False)
class Run:
    """A run of a scene. The output 'critical-slope' is computed by the method `critical_slope`, and so are the others.

    What several outputs share is made when the first of them asks for it.
    """

    scene: Any
    progress: Progress

    def __post_init__(self) -> None:
        """Makes what all outputs need."""

    def say(self, text: str) -> None:
        """Reports a step."""
        self.progress(f"{self.scene.name}: {text}")

    def compute(self, output: str) -> Result:
        """One output by its name."""
        found: Result = getattr(self, output.replace("-", "_"))()
        return found

    def result(self, data: dict[str, Any], shown: Sequence[Shown], complete: bool = True, long: Sequence[str] = (),
               outputs: Sequence[str] = ()) -> Result:
        """All outputs: one that fails, or is interrupted, takes nothing from what was computed before.

        `data` and `shown` are what the result begins with; `long` outputs are not begun once there was an interruption. Failures
        are reported in the text and in data["failed"], an interruption by data["complete"] = False. By default the outputs are
        those of the scene.

        Raises
        ------
        FemsubError
            The first failure, where every output has failed.
        """
        outputs = [output for output in outputs or self.scene.outputs if output != PAGE]
        parts = [Result({}, shown)]
        failed: dict[str, FemsubError] = {}
        with Interruptible() as work:
            for output in outputs:
                if output in long and not complete:
                    continue
                try:
                    part = self.compute(output)
                except FemsubError as error:  # the others are worth having without it
                    failed[output] = error
                    part = Result({}, [f"{output}: failed; {error}"])
                parts.append(part)
                complete = complete and part.data.get("complete", True)  # False: interrupted within it
        complete = complete and work.complete
        if failed and len(failed) == len(outputs):
            raise next(iter(failed.values()))
        for part in parts:
            data |= part.data
        if failed:
            data["failed"] = {output: f"{type(error).__name__}: {error}" for output, error in failed.items()}
        if not complete:
            data["complete"] = False
            parts.append(Result({}, ["Interrupted: these results are incomplete."]))
        every = [one for part in parts for one in (*[""] * bool(part is not parts[0] and part.text()), *part.shown)]
        return Result(data, every, {name: file for part in parts for name, file in part.files.items()}, shown)


def load(source: str, trusted: Sequence[str] = ()) -> tuple[Scene, Callable[[Scene, Progress], Result]]:
    """A scene with the function that runs it: by the name of a built-in one, or from a TOML, Python or results.json file.

    A Python file is run if it is the source, or if the source names it and it lies beside the source or is one of `trusted`.

    Raises
    ------
    InputError
        No such scene or file, not TOML, a key that does not exist (the nearest one is named), a value of the wrong type; a
        Python file that is not to be run.
    """
    path = Path(source)
    if source in SCENES or (path.suffix == OWN and path.is_file()):
        return built({"scene": source})
    if not path.is_file():
        if path.suffix in (".toml", OWN) or "/" in source:
            raise InputError(f"there is no scene file {source}")
        raise unknown_name("scene", source, SCENES)
    if path.suffix == ".json":
        from femsub.app.inputs import inputs_of

        table, folder = inputs_of(path)
        return built(table, folder, path, trusted)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # text that is no TOML or no UTF-8, a number of more than 4,300 digits
        raise InputError(f"{source} is not a TOML file: {error}") from None
    except RecursionError:
        raise InputError(f"{source} is no scene file: its brackets are nested too deeply") from None
    except OSError as error:
        raise InputError(f"{source} cannot be read: {error.strerror or error}") from None
    if not table:
        raise InputError(f'{source} names no scene: it is empty, or has comments only. Begin it with scene = "chain", or '
                         "another name of `femsub scenes`")
    return built(table, path.parent, path, trusted)


def built(table: Mapping[str, Any], folder: Path = Path("."), source: Path | None = None, trusted: Sequence[str] = ()) \
        -> tuple[Scene, Callable[[Scene, Progress], Result]]:
    """The scene that a table describes; files in it are named as seen from the folder. None is a source that the user named."""
    values = dict(table)
    kind = values.pop("scene", "chain")
    own = str(folder / kind) if isinstance(kind, str) and kind.endswith(OWN) else ""
    # a Python file that a scene file or a results.json names runs only if it lies beside it, or if its user allows it
    if own and source is not None:
        try:
            whole = resolved(Path(own))
            allowed = whole.parent == resolved(source.parent) or whole in map(resolved, trusted)
        except ValueError:
            allowed = False
        if not allowed:
            raise InputError(f"{source} names the Python file {Path(own)}, which is not beside it and would be executed. Read it "
                             f"first, then allow it: femsub run {source} --trust {Path(own)}")
    scene_type, run = scene_of(own or kind)
    needed = [name for name, one in keys_of(scene_type).items() if one.required]
    if needed and not values:
        raise InputError(f"the scene {kind!r} needs a scene file with {', '.join(needed)}; to begin one: femsub new {kind} > "
                         "my.toml")
    taken = "" if "scene" in table else (f". The file names no scene, so that it is read as one of {kind!r}; `femsub scenes` "
                                         "lists the others")
    try:
        values = values_of(scene_type, values)
    except InputError as error:
        raise InputError(f"{error}{taken}") from None
    name = word("scene key 'name'", values.get("name", ""))
    if len(name) > LONGEST_NAME or set(name) & set("/\\"):
        raise InputError(f"scene key 'name': {shown(name)} cannot be part of a file's name. Take at most {LONGEST_NAME} "
                         "characters without / and \\")
    return scene_type(**{"name": Path(own).stem if own else kind, **values, "own": own, "folder": str(folder)}), run


def scene_of(name: str) -> tuple[type[Scene], Callable[[Any, Progress], Result]]:
    """The class of a built-in scene, or of one in a Python file, and the function that runs it."""
    if isinstance(name, str) and name.endswith(OWN):
        kind, path = "SCENE", Path(name)
        if not path.is_file():
            raise InputError(f"there is no scene file {path}")
        spec = spec_from_file_location(f"scene_{path.stem}", path)
        assert spec is not None and spec.loader is not None
        module = sys.modules[spec.name] = module_from_spec(spec)  # dataclasses look for their module there
        try:
            spec.loader.exec_module(module)
        except FemsubError:
            raise
        except Exception as error:
            raise InputError(f"{path} cannot be read: {type(error).__name__}: {error}") from error
    else:
        place, _, kind = SCENES[choice("scene", name, SCENES)][0].partition(":")
        module = import_module(f"femsub.app.scenes.{place}")
    scene = getattr(module, kind or "SCENE", None)
    run = getattr(module, "run", getattr(scene, "run", None))
    if not (isinstance(scene, type) and issubclass(scene, Scene) and callable(run) and run is not Scene.run):
        raise InputError(f"{name} is no scene: it needs SCENE, a class derived from femsub.app.scene.Scene, and "
                         "run(scene, progress), which returns a Result")
    return scene, run


def _known(name: str, valid: Mapping[str, Any]) -> str:
    """'craig-bampton' for CraigBampton and HCB, which are the method's names elsewhere."""
    if name in valid:
        return name
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()
    return SHORT_NAMES.get(plain, plain)
