"""Scene files: what may stand in one, checked to the last key before anything is computed."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from femsub.checks import choice, finite_number, shown, whole_number
from femsub.errors import FemsubError, InputError, unknown_name
from femsub.io.atomic import Writer
from femsub.linalg.timing import Interruptible

if TYPE_CHECKING:
    from femsub import Belt

Progress = Callable[[str], None]

#: name of a built-in scene: (module in femsub.app.scenes, one line)
SCENES = {
    "chain": ("chain", "the paper's chain on a belt: full and reduced, its figures 2 to 4, error against run time"),
    "matrices": ("matrices", "your own M, D, K from files: reduced models, critical slope, error against time"),
    "beam": ("beam", "a steel beam on a belt: modes, critical slope, eigenvalues, error against run time"),
    "plate": ("plate", "a thin plate, made or from a mesh file: the same, with pictures and VTU files of shapes"),
    "solid": ("solid", "a solid, a brake's disc or your own mesh: the same"),
    "chain-transient": ("chain_transient", "the chain in time: full and reduced, spectrograms (Fig. 5)"),
    "solid-transient": ("solid_transient", "a disc in time: limit cycle, full against reduced, time per period"),
    "chain-limit-cycle": ("chain_cycles", "the chain's limit cycles, full and reduced: table, branches, stability"),
    "plate-limit-cycle": ("plate_cycles", "the plate's limit cycles over the normal force: full and reduced"),
}
MOST_REPEATS = 1000
SHORT_NAMES = {"hcb": "craig-bampton", "cc": "craig-chang"}  # of the literature


@dataclass(frozen=True)
class Scene:
    """What all scenes share.

    Attributes
    ----------
    name : str
        For headings and file names.
    slope : float, optional
        μ'(v0) itself. Without it, it comes from `law` at `speed`.
    law, eps, speed, force
        The friction law by its key ('stribeck-arctan', 'stribeck-arctan-odd', or one of your own, see
        `femsub.model.friction.FrictionLaw`), its width ε, the belt's speed and the normal force.
    methods : list of str
        Keys of reduction methods: 'craig-bampton', 'craig-chang', or one of your own, see `femsub.reduction.method.Method`.
        HCB, CC, and Python's CraigBampton and CraigChang will do.
    outputs : list of str
        What is computed; nothing else is. The scene's own list is the default, without what is only done on request.
    figures : bool
        Whether figures are drawn (in a folder given by --out).
    repeats : int
        Runs per time.
    """

    name: str = ""
    slope: float | None = None
    law: str = "stribeck-arctan"
    eps: float = 1e-3
    speed: float = 0.19113
    force: float = 1.0
    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang"])
    outputs: list[str] = field(default_factory=list)
    figures: bool = True
    repeats: int = 5

    OUTPUTS: ClassVar[tuple[str, ...]] = ()
    ON_REQUEST: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        from femsub.model.friction import LAWS
        from femsub.reduction.reduce import METHODS

        if not self.outputs:
            object.__setattr__(self, "outputs", list(self.OUTPUTS))
        object.__setattr__(self, "methods", [name if name in METHODS else _hyphenated(name) for name in self.methods])
        object.__setattr__(self, "law", self.law if self.law in LAWS else _hyphenated(self.law))
        known = self.OUTPUTS + self.ON_REQUEST
        for kind, values, valid in (("method", self.methods, METHODS), ("output", self.outputs, known),
                                    ("law", [self.law], LAWS)):
            for value in values:
                choice(kind, value, valid)
        if not self.methods:
            raise InputError(f"methods is empty; valid: {', '.join(METHODS)}")
        whole_number("repeats", self.repeats, least=1, most=MOST_REPEATS)
        if self.force < 0:
            raise InputError(f"force must not be negative, but is {self.force!r}: the belt presses, it does not pull")

    @property
    def labels(self) -> str:
        """The methods' names in tables: 'Craig-Bampton and Craig-Chang'."""
        from femsub.reduction.reduce import METHODS

        return " and ".join(METHODS[key].label for key in self.methods)

    @property
    def rubbing(self) -> Belt:
        """The belt with its law.

        Raises
        ------
        InputError
            There is a slope instead of a law.
        """
        from femsub.model.friction import LAWS, Belt

        if self.slope is not None:
            raise InputError("scene key 'slope': the nonlinear model needs a friction law, i.e. law, eps and speed, not a "
                             "slope")
        return Belt(force=self.force, speed=self.speed, law=LAWS[self.law](eps=self.eps))

    @property
    def linear_belt(self) -> Belt:
        """The belt with its slope alone, given or from the law."""
        from femsub import Belt

        return Belt(force=self.force, slope=self.rubbing.slope if self.slope is None else self.slope)

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
    rows : list of dict
        For results.csv.
    text : str
        The tables for the terminal.
    drawings : dict of str to callable
        File name (without ending) to a function that draws onto a new matplotlib figure.
    files : dict of str to callable
        File name, which may name a folder below that of the results, to a function that writes the file's content. Called
        only where there is a folder to write to.
    """

    data: dict[str, Any]
    rows: list[dict[str, Any]]
    text: str
    drawings: dict[str, Callable[[], Any]]
    files: dict[str, Writer] = field(default_factory=dict)


def run_outputs(outputs: Sequence[str], compute: Callable[[str], Result], data: dict[str, Any], text: list[str],
                complete: bool = True, long: Sequence[str] = ()) -> Result:
    """A result, output by output: one that fails, or is interrupted, takes nothing from what was computed before.

    `data` and `text` are what the result begins with; `long` outputs are not begun once there was an interruption. Failures are
    told in the text and in data["failed"], an interruption by data["complete"] = False.

    Raises
    ------
    FemsubError
        The first failure, where every output has failed.
    """
    rows: list[dict[str, Any]] = []
    drawings: dict[str, Callable[[], Any]] = {}
    files: dict[str, Writer] = {}
    failed: dict[str, FemsubError] = {}
    with Interruptible() as work:
        for output in outputs:
            if output in long and not complete:
                continue
            try:
                part = compute(output)
            except FemsubError as error:  # the others are worth having without it
                failed[output] = error
                text.append(f"{output}: failed; {error}")
                continue
            data |= part.data
            rows += [{"output": output, **row} for row in part.rows]
            drawings |= part.drawings
            files |= part.files
            if part.text:
                text.append(part.text)
            complete = complete and part.data.get("complete", True)  # False: interrupted within it
    complete = complete and work.complete
    if failed and len(failed) == len(outputs):
        raise next(iter(failed.values()))
    if failed:
        data["failed"] = {output: f"{type(error).__name__}: {error}" for output, error in failed.items()}
    if not complete:
        data["complete"] = False
        text.append("Interrupted: these results are incomplete.")
    return Result(data, rows, "\n\n".join(text), drawings, files)


def load(source: str) -> tuple[Scene, Callable[[Scene, Progress], Result]]:
    """A scene by the name of a built-in one or from a TOML file, with the function that runs it.

    Raises
    ------
    InputError
        No such scene or file, not TOML, a key that does not exist (the nearest one is named), a value of the wrong type.
    """
    if source in SCENES:
        return _build({"scene": source}, Path("."))
    path = Path(source)
    if not path.is_file():
        if path.suffix == ".toml" or "/" in source:
            raise InputError(f"there is no scene file {source}")
        raise unknown_name("scene", source, SCENES)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{source} is not a TOML file: {error}") from None
    except RecursionError:
        raise InputError(f"{source} is no scene file: its brackets are nested too deeply") from None
    except OSError as error:
        raise InputError(f"{source} cannot be read: {error.strerror or error}") from None
    return _build(table, path.parent)


def _build(table: Mapping[str, Any], folder: Path) -> tuple[Scene, Callable[[Scene, Progress], Result]]:
    values = dict(table)
    kind = choice("scene", values.pop("scene", "chain"), SCENES)
    if kind == "matrices" and not values:
        raise InputError("the scene 'matrices' needs a scene file that names them: scene = \"matrices\", M = \"M.mtx\", "
                         "K = \"K.mtx\", port = 0, band = [0.0, 1000.0]")
    module = import_module(f"femsub.app.scenes.{SCENES[kind][0]}")
    scene_type = module.SCENE
    fields = {item.name: item for item in dataclasses.fields(scene_type)}
    takes_folder = fields.pop("folder", None) is not None
    for key, value in values.items():
        if key not in fields:
            raise unknown_name("scene key", key, ["scene", *fields])
        if value == []:
            raise InputError(f"scene key {key!r} is an empty list; leave the key out to take its default")
        values[key] = _typed(key, value, str(fields[key].type))
    if takes_folder:
        values["folder"] = str(folder)
    return scene_type(**{"name": kind, **values}), module.run


def _hyphenated(name: str) -> str:
    """'craig-bampton' for CraigBampton and HCB, which are the method's names elsewhere."""
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()
    return SHORT_NAMES.get(plain, plain)


def _fits(value: Any, kind: str) -> bool:
    kinds: dict[str, Any] = {"bool": bool, "int": int, "float": (int, float), "str": str}
    return isinstance(value, kinds.get(kind, ())) and (kind == "bool" or not isinstance(value, bool))


def _typed(key: str, value: Any, declared: str) -> Any:
    """The value if it is of the declared type; whole numbers do for floats, one value for a list of one."""
    kinds = [part.strip() for part in re.split(r"\|(?![^\[]*\])", declared)]  # not the | inside list[...]
    for kind in kinds:
        if kind.startswith("list["):
            items, inner = value if isinstance(value, list) else [value], kind[5:-1]
            if all(any(_fits(item, one.strip()) for one in inner.split("|")) for item in items):
                return [_typed(key, item, inner) for item in items]
        elif _fits(value, kind):
            return finite_number(f"scene key {key!r}", value) if kind == "float" else value
    wanted = " or ".join(kind for kind in kinds if kind != "None")
    raise InputError(f"scene key {key!r} must be {wanted}, not {shown(value)}")
