"""The house rules that a machine can check: rooms in the order of the method, one importer of PETSc, cheap imports."""

from __future__ import annotations

import ast
import gc
import inspect
import re
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "femsub"

#: The vocabulary, then the rooms in the order of the method. Rooms of one line do not know each other, but for the vocabulary,
#: which knows no room. "femsub" is the front door itself, which imports from all rooms before the last.
ORDER = (("checks", "output"), ("algebra",), ("model",), ("components",), ("coupling",), ("modes",), ("reduction",),
         ("stability",), ("io", "motion"), ("studies",), ("femsub",), ("app",), ("__main__",))
LEVEL = {room: level for level, rooms in enumerate(ORDER) for room in rooms}
ROOMS = 15  # entries of the package beside its __init__, at most
ACROSS = 298  # later work does not move it
PRIVATE = 13  # uses of private names of femsub's modules in tests, at most
DRAWERS = ("figures.py", "pictures.py")  # import matplotlib


@cache
def _nodes(text: str) -> list[ast.AST]:
    return list(ast.walk(ast.parse(text)))


@pytest.fixture(scope="module", autouse=True)
def _nodes_are_let_go() -> Iterator[None]:
    """Half a million of them would slow the garbage collector down, here and in all later tests."""
    gc.disable()
    yield
    _nodes.cache_clear()
    gc.enable()


def nodes(path: Path) -> list[ast.AST]:
    """All nodes of a file's syntax tree, which several rules read."""
    return _nodes(path.read_text(encoding="utf-8"))


def modules(package: Path = PACKAGE) -> list[Path]:
    """All files but the front door, whose names are imported when they are first used."""
    return [path for path in sorted(package.rglob("*.py")) if path != package / "__init__.py"]


def room(module: str) -> str:
    """'modes' of 'femsub.modes.normal_modes'."""
    return [*module.split("."), "femsub"][1]


def name_of(path: Path, package: Path = PACKAGE) -> str:
    parts = path.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path, package: Path = PACKAGE) -> set[str]:
    """Modules of femsub that a file imports at run time (not under TYPE_CHECKING): in any spelling, in functions as well."""
    return _imported(path.read_text(encoding="utf-8"), path, package)


@cache
def _imported(text: str, path: Path, package: Path) -> set[str]:
    tree = _nodes(text)
    skipped = {id(node) for test in tree if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.dump(test.test)
               for child in test.body for node in ast.walk(child)}
    here = name_of(path, package).split(".")
    here = here if path.name == "__init__.py" else here[:-1]
    names = set()
    for node in tree:
        if id(node) in skipped:
            continue
        if isinstance(node, ast.ImportFrom):
            base = ".".join([*here[:len(here) - node.level + 1], *([node.module] if node.module else [])]) if node.level \
                else node.module or ""
            for alias in node.names:  # a name may be a module
                whole = f"{base}.{alias.name}".replace(".", "/")
                inside = (package.parent / f"{whole}.py").exists() or (package.parent / whole).is_dir()
                names.add(f"{base}.{alias.name}" if inside else base)
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {name for name in names if name.split(".")[0] == "femsub"}


def external(path: Path) -> set[str]:
    return {(alias.name if isinstance(node, ast.Import) else node.module or "").split(".")[0]
            for node in nodes(path) if isinstance(node, (ast.Import, ast.ImportFrom)) for alias in node.names}


def upward(path: Path, package: Path = PACKAGE) -> set[str]:
    """What a file imports from rooms that do not come before its own."""
    here = room(name_of(path, package))
    return {name for name in imported(path, package)
            if (other := room(name)) != here and LEVEL[other] >= max(LEVEL[here], 1)}


def across(package: Path = PACKAGE) -> Counter[tuple[str, str]]:
    """How many imports lead from one room into another, by pairs of rooms; those of the vocabulary do not count."""
    return Counter((here, room(name)) for path in modules(package) for name in imported(path, package)
                   if (here := room(name_of(path, package))) != room(name) and LEVEL[room(name)] > 0)


def circle(package: Path = PACKAGE) -> list[str]:
    """Modules that import each other in a circle, or none."""
    try:
        TopologicalSorter({name_of(path, package): imported(path, package) for path in modules(package)}).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def unexplained(package: Path = PACKAGE) -> list[str]:
    """Rooms whose docstring does not say what goes in and what comes out."""
    rooms = [name for name in LEVEL if (package / name).is_dir()]
    texts = {name: (package / name / "__init__.py").read_text(encoding="utf-8") for name in rooms}
    return [name for name, text in texts.items()
            if not re.search(r"\bIn: .+Out: ", ast.get_docstring(ast.parse(text)) or "", re.DOTALL)]


def offenders(rule: Callable[[Path], object], paths: Iterable[Path] | None = None) -> dict[str, object]:
    """What a rule finds, by the modules in which it finds anything."""
    found = {str(path.relative_to(PACKAGE)): rule(path) for path in (modules() if paths is None else paths)}
    return {name: fault for name, fault in found.items() if fault}


def test_imports_go_to_rooms_before() -> None:
    assert not offenders(upward)


def test_imports_across_rooms_are_few(capsys: pytest.CaptureFixture[str]) -> None:
    pairs = across()
    with capsys.disabled():
        print(f"\n{pairs.total()} imports across rooms:", ", ".join(f"{here} → {there} {count}" for (here, there), count in
                                                                  sorted(pairs.items())))
    assert pairs.total() <= ACROSS


def test_no_modules_import_each_other() -> None:
    assert not circle()


def test_the_rooms_are_few_and_each_says_what_it_is() -> None:
    inside = {path.name.removesuffix(".py") for path in PACKAGE.iterdir() if path.stem not in ("__init__", "__pycache__")}
    assert inside == set(LEVEL) - {"femsub"} | {"py.typed"} and len(inside) <= ROOMS
    assert not unexplained()


def test_all_of_the_package_is_installed_and_no_more() -> None:
    settings = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    assert set(settings["tool"]["setuptools"]["packages"]) == {name_of(path) for path in PACKAGE.rglob("__init__.py")}


def test_no_command_edits_the_path_that_modules_are_found_on() -> None:
    root = PACKAGE.parent
    scripts = [path for path in (root / "scripts").iterdir() if path.is_file()]  # Python writes its bytecode into a folder there
    for path in [*scripts, *(root / "benchmarks").rglob("*.py"), *(root / "tests").glob("*.py")]:
        assert not re.search(r"sys[.]path(\.\w+\(|\[.*\]\s*=|\s*\+?=)", path.read_text(encoding="utf-8")), path


# the rules see what they forbid


def package_of(folder: Path, **files: str) -> Path:
    """A package femsub of two rooms, model and modes, with these lines in their modules."""
    package = folder / "femsub"
    for name in ("model", "modes"):
        (package / name).mkdir(parents=True)
        (package / name / "__init__.py").write_text('"""A room. In: a thing. Out: another."""')
        for module in ("one", "two"):
            (package / name / f"{module}.py").write_text(files.get(f"{name}_{module}", ""))
    return package


@pytest.mark.parametrize("line", [
    "import femsub.modes.one", "from femsub.modes import one", "from femsub.modes.one import f", "from femsub import modes",
    "from ..modes import one", "from ..modes.one import f", "from .. import modes",
    "def f():\n    from femsub.modes.one import f",
    "class A:\n    def f(self):\n        import femsub.modes.one as m", "if True:\n    from femsub import modes as m",
    "from femsub import normal_modes", "import femsub as fs"])
def test_an_upward_import_is_seen(tmp_path: Path, line: str) -> None:
    package = package_of(tmp_path, model_one=line, modes_one="from femsub.model.two import f")
    assert upward(package / "model" / "one.py", package) and not upward(package / "modes" / "one.py", package)


def test_the_vocabulary_imports_no_room(tmp_path: Path) -> None:
    package = package_of(tmp_path)
    (package / "checks.py").write_text("from femsub.model.one import f")
    assert upward(package / "checks.py", package)
    (package / "checks.py").write_text("from femsub.output import draw")
    assert not upward(package / "checks.py", package)


def test_imports_for_type_checkers_and_of_ones_own_room_are_none(tmp_path: Path) -> None:
    package = package_of(tmp_path, model_one="from .two import f\nif TYPE_CHECKING:\n    from femsub.modes.one import f")
    assert imported(package / "model" / "one.py", package) == {"femsub.model.two"}
    assert not upward(package / "model" / "one.py", package)


@pytest.mark.parametrize("line", ["from femsub.model import one", "def f():\n    from .one import f"])
def test_a_circle_within_a_room_is_seen(tmp_path: Path, line: str) -> None:
    package = package_of(tmp_path, model_one="from femsub.model.two import f", model_two=line)
    assert {*circle(package)} == {"femsub.model.one", "femsub.model.two"}
    (package / "model" / "two.py").write_text("")
    assert not circle(package)


def test_a_room_that_does_not_say_what_comes_out_is_seen(tmp_path: Path) -> None:
    package = package_of(tmp_path)
    assert not unexplained(package)
    (package / "modes" / "__init__.py").write_text('"""Modes. In: matrices."""')
    assert unexplained(package) == ["modes"]


def test_one_importer_of_petsc_and_one_of_matplotlib() -> None:
    def forbidden(path: Path) -> set[str]:
        own = {"petsc4py", "slepc4py"} if path == PACKAGE / "algebra" / "petsc.py" else set()
        own |= {"matplotlib"} if path.name in DRAWERS else set()
        return external(path) & {"petsc4py", "slepc4py", "matplotlib"} - own

    assert not offenders(forbidden)


def printed_by_hand(package: Path = PACKAGE) -> list[Path]:
    """Modules of the last room that print rows themselves, whose heads would be unknown to files and pages."""
    return [path for path in (package / "app").rglob("*.py") for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) == "table"]


def test_scenes_give_tables_and_print_none(tmp_path: Path) -> None:
    assert not printed_by_hand()
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "one.py").write_text("from femsub.output import table\nprint(table(['a'], [[1]], ['d']))\n")
    assert len(printed_by_hand(tmp_path)) == 1


def seconds(code: str) -> float:
    runs = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        runs.append(time.perf_counter() - start)
    return min(runs)


def test_import_is_cheap() -> None:
    assert seconds("import femsub") < 1.5 * seconds("import numpy, scipy.sparse")


def test_type_checkers_see_every_name_of_the_front_door() -> None:
    """A package with py.typed exports to them what is imported `as` itself, and nothing else (PEP 484)."""
    froms = [node for node in nodes(PACKAGE / "__init__.pyi") if isinstance(node, ast.ImportFrom)]
    private = [alias.name for node in froms for alias in node.names if alias.asname != alias.name]
    assert not private, f"write `{private[0]} as {private[0]}`"


def test_every_name_of_the_front_door_exists() -> None:
    import femsub as fs

    for name in fs.__all__:
        assert getattr(fs, name) is not None
    # a room of the same name would hide the function once it is imported
    assert not {path.stem for path in PACKAGE.iterdir()} & set(fs.__all__)
    with pytest.raises(AttributeError, match=r"attribute .?missing"):
        fs.missing  # noqa: B018


def of_evidence(path: Path) -> set[str]:
    """Where code says that a result is certified or confirmed without a Tally: lines with the words, or with their names."""
    return {f"{path.name}:{node.lineno}" for node in nodes(path)
            if (isinstance(node, ast.Constant) and node.value in {"certified", "confirmed"})
            or (isinstance(node, ast.Name) and node.id in {"CERTIFIED", "CONFIRMED"})
            or (isinstance(node, ast.alias) and node.name in {"CERTIFIED", "CONFIRMED"})}


def counts_what_it_lists(path: Path) -> set[str]:
    """Tallies that are given one and the same expression as what is listed and what was counted; (0, 0) is an empty list."""
    calls = [node for node in nodes(path) if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Tally")]
    return {f"{path.name}:{node.lineno}" for node in calls if len(node.args) > 1
            and ast.unparse(node.args[0]) == ast.unparse(node.args[1]) != "0"}


def test_only_a_tally_says_certified() -> None:
    paths = [path for path in modules() if path.name != "checks.py"]
    assert not offenders(of_evidence, paths) and not offenders(counts_what_it_lists, paths)


def test_a_shortcut_to_certified_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text("from femsub.checks import CERTIFIED\nword = 'confirmed'\nx = Tally(n, n)\ny = Tally(n, m)\n")
    assert of_evidence(path) == {"module.py:1", "module.py:2"} and counts_what_it_lists(path) == {"module.py:3"}


#: Names that `evidence` stands for: no attribute, field, argument, method or text that is one word says it otherwise.
OF_PROOF = re.compile(r"_?(is_)?(certified|certify|confirmed|confirm|proved|proven|proof)")


def names_of(path: Path) -> set[tuple[str, int]]:
    """The names of attributes, fields, arguments, functions and classes, with their lines; local variables are free."""
    found = set()
    for node in nodes(path):
        field = {ast.Attribute: "attr", ast.arg: "arg", ast.keyword: "arg", ast.FunctionDef: "name", ast.ClassDef: "name"}
        if name := getattr(node, field.get(type(node), ""), None):
            found.add((name, node.lineno))
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add((node.target.id, node.lineno))
        if isinstance(node, ast.Dict):
            found |= {(key.value, key.lineno) for key in node.keys
                      if isinstance(key, ast.Constant) and isinstance(key.value, str)}
    return found


def other_words_for_proof(path: Path) -> set[str]:
    return {f"{path.name}:{line} {name}" for name, line in names_of(path)
            if OF_PROOF.fullmatch(name)}


def test_evidence_is_the_only_word_for_proof() -> None:
    assert not offenders(other_words_for_proof)


def test_another_word_for_proof_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text("class A:\n    certified: bool\n    def proved(self):\n        proof = f(confirmed=1)\n"
                    "        return {'proven': 1}\nx.is_confirmed\n")
    assert {one.split(":")[1] for one in other_words_for_proof(path)} == {
        "2 certified", "3 proved", "4 confirmed", "5 proven", "6 is_confirmed"}


def other_words_for_tolerance(path: Path) -> set[str]:
    """Arguments and fields called `tolerance` or `rtol`, where `tol` is the word; scene files have a key `tolerance`."""
    return {f"{path.name}:{node.lineno}" for node in nodes(path)
            if (isinstance(node, ast.arg) and node.arg in ("tolerance", "rtol"))
            or (isinstance(node, ast.AnnAssign) and ast.unparse(node.target) in ("tolerance", "rtol"))}


def test_tol_is_the_only_word_for_tolerances() -> None:
    assert not offenders(other_words_for_tolerance, [path for path in modules() if "app" not in path.parts])


def test_another_word_for_tolerances_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text("def f(tolerance):\n    return solve(rtol=tolerance)\nclass A:\n    rtol: float = 1\n    tol: float = 1\n")
    assert other_words_for_tolerance(path) == {"module.py:1", "module.py:4"}


def private_names_in(folder: Path) -> list[str]:
    """Where tests reach for a module's private names."""
    own = {path.stem for path in modules()}
    files = [path for path in sorted(folder.glob("test_*.py")) if re.search(r"[.]\s*_[a-z]", path.read_text(encoding="utf-8"))]
    return [f"{path.name}:{node.lineno} {ast.unparse(node)}" for path in files for node in nodes(path)
            if isinstance(node, ast.Attribute) and re.match(r"_[a-z]", node.attr) and isinstance(node.value, ast.Name)
            and node.value.id in own]


def test_tests_use_few_private_names(tmp_path: Path) -> None:
    found = private_names_in(PACKAGE.parent / "tests")
    assert len(found) <= PRIVATE, found
    (tmp_path / "test_x.py").write_text("petsc._load()\npetsc.load()\nself._x\nmemory.__doc__\n")
    assert private_names_in(tmp_path) == ["test_x.py:1 petsc._load"]


@cache
def _files(folder: Path) -> set[str]:
    return {file.stem for file in folder.rglob("*.py")}


def past_the_door(path: Path, package: Path = PACKAGE) -> set[str]:
    """Imports of another room's file where the room's own name would do. A name that is a file's as well is asked there."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and (parts := (node.module or "").split("."))[0] == "femsub" and len(parts) > 2 \
                and parts[1] not in (room(name_of(path, package)), "app"):
            files = _files(package / parts[1])
            found |= {f"{node.module}.{alias.name}" for alias in node.names if alias.name not in files}
    return found


def test_other_rooms_are_entered_by_their_door() -> None:
    assert not offenders(past_the_door)


def test_a_way_past_the_door_is_seen(tmp_path: Path) -> None:
    package = package_of(tmp_path, modes_one="from femsub.model.one import f\nfrom femsub.model.two import two\n"
                                             "from femsub.model import g\nfrom femsub.modes.two import h")
    assert past_the_door(package / "modes" / "one.py", package) == {"femsub.model.one.f"}


# one question, one path


def classes(package: Path = PACKAGE) -> Iterator[tuple[str, ast.ClassDef]]:
    for path in modules(package):
        yield from ((name_of(path, package), node) for node in nodes(path) if isinstance(node, ast.ClassDef))


def members(node: ast.ClassDef) -> set[str]:
    """Fields and methods of a class."""
    return {item.target.id if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name) else item.name
            for item in node.body if isinstance(item, (ast.FunctionDef, ast.AnnAssign))}


def test_no_two_classes_have_one_name() -> None:
    """Classes of kinds bear the name of their family: ChainPart, RigidJointKind, BeltContactKind, BranchAsk."""
    names = Counter(node.name for _, node in classes())
    assert not {name for name, count in names.items() if count > 1}


@pytest.mark.parametrize(("family", "ending"), [("part", "Part"), ("joint", "JointKind"), ("contact", "ContactKind"),
                                                ("ask", "Ask")])
def test_a_kind_is_a_file_whose_class_has_its_name_and_that_of_its_family(family: str, ending: str) -> None:
    for path in (PACKAGE / "app" / f"{family}s").glob("[!_]*.py"):
        made = "".join(map(str.capitalize, path.stem.split("_"))) + ending
        kinds = [node for node in nodes(path) if isinstance(node, ast.ClassDef) and "KIND" in members(node)]
        assert [node.name for node in kinds] == [made], path
        assert f'KIND: ClassVar[str] = "{path.stem.replace("_", "-")}"' in path.read_text(encoding="utf-8")


def answers_of(package: Path = PACKAGE) -> tuple[set[str], set[str], set[str]]:
    """Classes that answer where stability is lost, those that hold the answer, and modules that make one."""
    solvers = {node.name for _, node in classes(package) if members(node) >= {"unfit", "solve"}} - {"Solver"}  # the protocol
    results = {node.name for _, node in classes(package) if members(node) >= {"losses", "regains"}}
    makers = {name_of(path, package) for path in modules(package) for node in nodes(path)
              if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[0] in results}
    return solvers, results, makers


def test_the_loss_of_stability_has_three_solvers_and_one_result() -> None:
    from femsub.stability.critical_value import SOLVERS

    solvers, results, makers = answers_of()
    assert solvers == {type(solver).__name__ for solver in SOLVERS.values()} == {"Discs", "Followed", "PortRoot"}
    assert results == {"CriticalValue"}
    assert makers == {f"femsub.stability.{name}" for name in ("discs", "followed", "port_root")}
    roots = {name_of(path) for path in modules() for node in nodes(path)
             if isinstance(node, ast.ImportFrom) and any(alias.name == "brentq" for alias in node.names)}
    assert roots == {"femsub.stability.border", "femsub.motion.cycles.hopf"}  # the latter: where μ'(v) has a value


def test_another_answer_is_seen(tmp_path: Path) -> None:
    package = package_of(tmp_path, modes_one="class Border:\n    losses: int\n    regains: int\nclass Secant:\n"
                                             "    def unfit(self): 0\n    def solve(self): return Border(1, 2)")
    assert answers_of(package) == ({"Secant"}, {"Border"}, {"femsub.modes.one"})


def public_arguments() -> dict[str, list[str]]:
    """The names of the arguments of each public function."""
    import femsub

    found = {name: getattr(femsub, name) for name in femsub.__all__}
    return {name: list(inspect.signature(one).parameters) for name, one in found.items()
            if callable(one) and not isinstance(one, type)}


def test_contacts_have_one_name_and_a_comparison_one_row() -> None:
    named = public_arguments()
    other = {name for name, arguments in named.items() if {"belts", "slope", "slopes", "mu"} & set(arguments)}
    numbers = {"chain", "cut_chain", "chain_limit_cycle"}  # there `belt` is the number of a mass
    assert not other and {name for name, arguments in named.items() if "belt" in arguments} <= numbers
    assert {name for name, arguments in named.items() if {"port", "force"} <= set(arguments)} == {"critical_slope"}
    asked = {"complex_modes", "critical_value", "sweep", "track", "study", "self_excitation", "transient", "harmonic_balance",
             "shoot", "branch", "reduce", "refine"}
    assert asked <= {name for name, arguments in named.items() if "contacts" in arguments}
    assert [node.name for _, node in classes() if node.name.endswith("Row")] == ["Row"]
