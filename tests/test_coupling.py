"""Parts joined: the coupled system is the unreduced one when all modes are kept, whatever the parts are and their order."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra.elimination import product

STEEL = {"E": 2.1e11, "I": 1e-8, "rho": 7850.0, "A": 1e-4}
Make = Callable[[fs.Substructure], fs.Substructure]


def complete(method: type) -> Make:
    """A reduction that keeps every mode there is."""

    def make(part: fs.Substructure) -> fs.Substructure:
        rigid = fs.normal_modes(part, count=0).rigid
        return fs.reduce(part, method(len(part.interior) if method is fs.CraigBampton else part.size - rigid))

    return make


HOW: dict[str, Make] = {"full": lambda part: part, "craig-bampton": complete(fs.CraigBampton),
                        "craig-chang": complete(fs.CraigChang)}


def elastic(model: fs.Substructure) -> np.ndarray:
    """All ω² of a small model, by LAPACK."""
    K, M = (A.toarray() if sp.issparse(A) else A for A in (model.K, model.M))
    return la.eigh(K, M, eigvals_only=True)


def agree(model: fs.Substructure, reference: np.ndarray, tol: float = 1e-9, rigid: int = 0) -> None:
    found = elastic(model)
    assert len(found) == len(reference)
    assert np.abs(found[:rigid]).max(initial=0.0) < 1e-7 * reference[rigid]
    np.testing.assert_allclose(np.sqrt(found[rigid:]), np.sqrt(reference[rigid:]), rtol=tol)


def cut(n: int, pieces: int, fixed: bool = True) -> tuple[dict[str, fs.Substructure], list[fs.Rigid], fs.Substructure]:
    """A chain of n masses cut into pieces, each with half of the mass it shares with the next; joints; and the chain."""
    masses, springs = np.linspace(1.0, 2.0, n), np.linspace(3.0, 1.0, n)
    ends = np.linspace(0, n - 1, pieces + 1).astype(int)
    parts, joints = {}, []
    for i, (a, b) in enumerate(itertools.pairwise(ends)):
        m = masses[a:b + 1].copy()
        m[0] *= 1.0 if i == 0 else 0.5
        m[-1] *= 1.0 if i == pieces - 1 else 0.5
        count = b - a + 1
        parts[f"p{i}"] = fs.chain(count, belt=2, damping=0.1 if i == 0 else 0.0, masses=m, springs=springs[a:b + 1],
                                  interface=[1, count], fixed=fixed and i == 0, name=f"p{i}")
        if i:
            last = parts[f"p{i - 1}"].size - 1
            joints.append(fs.Rigid((f"p{i - 1}", [last]), (f"p{i}", [0])))
    return parts, joints, fs.chain(n, belt=2, damping=0.1, masses=masses, springs=springs, fixed=fixed)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("how", [("full",), ("craig-bampton",), ("craig-chang",), ("full", "craig-chang", "craig-bampton")])
@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("pieces", [2, 3, 5, 8])
def test_a_cut_chain_is_the_chain(pieces: int, fixed: bool, how: tuple[str, ...]) -> None:
    parts, joints, whole = cut(33, pieces, fixed)
    made = {name: HOW[how[i % len(how)]](part) for i, (name, part) in enumerate(parts.items())}
    system = fs.couple(made, joints)
    agree(system, elastic(whole), rigid=0 if fixed else 1)
    assert system.redundant == 0
    assert sp.issparse(system.K) if how == ("full",) else "full" in how or not sp.issparse(system.K)
    u = system.expand(np.eye(system.size))
    for joint in joints:
        (a, i), (b, j) = joint.ends
        np.testing.assert_allclose(u[a][i], u[b][j], atol=1e-12)
    # the interface that is left, and the ports, are those of the parts
    assert len(system.interface) == system.interface_rows.shape[0] == 2
    np.testing.assert_allclose((system.interface_rows @ np.eye(system.size)), np.vstack([u["p0"][:1], u[f"p{pieces - 1}"][-1:]]),
                               atol=1e-12)
    np.testing.assert_allclose(system.ports["p0.belt"], u["p0"][1], atol=1e-12)


def crosses(how: tuple[str, ...], arms: int) -> tuple[dict[str, fs.Substructure], np.ndarray]:
    """Chains that meet in one mass, and ω² of the whole."""
    n = 5
    parts = {}
    size = arms * (n - 1) + 1
    M, K = np.zeros((size, size)), np.zeros((size, size))
    for arm in range(arms):
        part = fs.chain(n, masses=np.linspace(1, 2, n) + 0.1 * arm, springs=1.0 + arm, interface=[n], fixed=arm % 2 == 0)
        rows = np.append(np.arange(n - 1) + 1 + arm * (n - 1), 0)
        M[np.ix_(rows, rows)] += part.M.toarray()
        K[np.ix_(rows, rows)] += part.K.toarray()
        parts[f"arm{arm}"] = HOW[how[arm % len(how)]](part)
    return parts, la.eigh(K, M, eigvals_only=True)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("how", [("full",), ("craig-bampton",), ("craig-chang",), ("craig-chang", "full"),
                                 ("full", "craig-chang", "craig-bampton")])
@pytest.mark.parametrize("arms", [3, 4])
@pytest.mark.parametrize("way", ["one", "star", "line", "loop"])
def test_a_cross_point_is_one_however_it_is_said(how: tuple[str, ...], arms: int, way: str) -> None:
    parts, reference = crosses(how, arms)
    ends = [(name, [4]) for name in parts]
    joints = {"one": [fs.Rigid(*ends)], "star": [fs.Rigid(ends[0], end) for end in ends[1:]],
              "line": [fs.Rigid(a, b) for a, b in itertools.pairwise(ends)],
              "loop": [fs.Rigid(a, b) for a, b in itertools.combinations(ends, 2)]}[way]
    system = fs.couple(parts, joints)
    agree(system, reference)
    assert system.redundant == (len(joints) - arms + 1 if way == "loop" else 0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how", list(HOW))
def test_parts_in_any_order_are_one_system(how: str) -> None:
    parts, joints, whole = cut(17, 4)
    parts = {name: HOW[how](part) for name, part in parts.items()}
    spectra, expected = [], elastic(whole)
    for order in itertools.permutations(parts):
        spectra.append(elastic(fs.couple({name: parts[name] for name in order}, joints[::-1])))
    for values in spectra:
        np.testing.assert_allclose(np.sqrt(values), np.sqrt(expected), rtol=1e-9)


@pytest.mark.parametrize("how", list(HOW))
def test_a_system_of_systems_is_one_system(how: str) -> None:
    parts, _, whole = cut(25, 4)
    parts = {name: HOW[how](part) for name, part in parts.items()}
    front = fs.couple({"a": parts["p0"], "b": parts["p1"]}, [fs.Rigid(("a", [parts_end(parts["p0"])]), ("b", [0]))])
    rear = fs.couple({"c": parts["p2"], "d": parts["p3"]}, [fs.Rigid(("c", [parts_end(parts["p2"])]), ("d", [0]))])
    assert len(front.interface) == len(rear.interface) == 2
    joint = fs.Rigid(("front", [front.interface[1]]), ("rear", [rear.interface[0]]))
    whole_again = fs.couple({"front": front, "rear": rear}, [joint])
    agree(whole_again, elastic(whole))
    u = whole_again.expand(np.arange(25.0))
    assert list(u) == ["front.a", "front.b", "rear.c", "rear.d"] and next(iter(whole_again.ports)) == "front.a.belt"
    np.testing.assert_allclose(u["front.b"][-1], u["rear.c"][0])
    for reduced in (fs.reduce(whole_again, fs.CraigBampton(23)), fs.reduce(whole_again, fs.CraigChang(25))):
        agree(reduced, elastic(whole))


def parts_end(part: fs.Substructure) -> int:
    return int(part.interface_numbers[-1])


def quarter(x: float, y: float) -> fs.Substructure:
    """One of four membranes (springs between the nodes of a 4 x 4 grid), with its edges named, in its place."""
    n = 4
    nodes = np.arange(n * n).reshape(n, n)
    K = np.zeros((n * n, n * n))
    for i, j in (*zip(nodes[:, :-1].ravel(), nodes[:, 1:].ravel(), strict=True),
                 *zip(nodes[:-1].ravel(), nodes[1:].ravel(), strict=True)):
        K[np.ix_([i, j], [i, j])] += (1 + 0.1 * x + 0.3 * y) * np.array([[1, -1], [-1, 1]])
    points = np.stack([np.repeat(np.arange(n), n) + (n - 1) * x, np.tile(np.arange(n), n) + (n - 1) * y], axis=1)
    edges = {"west": nodes[0], "east": nodes[-1][::-1], "south": nodes[:, 0], "north": nodes[:, -1]}
    return fs.Substructure(sp.diags_array(np.linspace(1, 2, n * n)), sp.csr_array(K), interface=edges,
                           dofs=fs.DofMap(np.arange(n * n) + 1, np.zeros(n * n, dtype=int), ("w",), points))


@pytest.mark.parametrize("how", list(HOW))
def test_four_quarters_meet_in_one_node_all_at_once_or_two_by_two(how: str) -> None:
    whole = fs.couple({f"{i}{j}": quarter(i, j) for i in (0, 1) for j in (0, 1)}, [
        fs.Rigid(("00", "east"), ("10", "west")), fs.Rigid(("01", "east"), ("11", "west")),
        fs.Rigid(("00", "north"), ("01", "south")), fs.Rigid(("10", "north"), ("11", "south"))])
    assert whole.size == 49 and whole.redundant == 1
    reference = elastic(whole)
    quarters = {f"{i}{j}": HOW[how](quarter(i, j)) for i in (0, 1) for j in (0, 1)}
    halves = [fs.couple({"l": quarters[f"0{j}"], "r": quarters[f"1{j}"]}, [fs.Rigid(("l", "east"), ("r", "west"))])
              for j in (0, 1)]
    for half in halves:  # the node that both edges share stays in both sets
        assert set(half.sets) == {f"{side}.{edge}" for side, lost in (("l", "east"), ("r", "west"))
                                  for edge in ("west", "east", "south", "north") if edge != lost}
        assert half.sets["l.north"][-1] == half.sets["r.north"][0]
    for made in (halves, [fs.reduce(half, fs.CraigBampton(len(half.interior))) for half in halves]):
        both = fs.couple({"low": made[0], "high": made[1]}, [
            fs.Rigid(("low", "l.north"), ("high", "l.south")), fs.Rigid(("low", "r.north"), ("high", "r.south"))])
        agree(both, reference, rigid=1)
        assert both.redundant == 1


def test_the_interface_that_stays_open_can_be_named() -> None:
    half = fs.couple({"l": quarter(0, 0), "r": quarter(1, 0)}, [fs.Rigid(("l", "east"), ("r", "west"))],
                     interface=[("l", "north"), ("r", "north"), ("l", [0])])
    assert len(half.interface) == 8 and set(half.sets) == {"l.north", "r.north"}
    np.testing.assert_array_equal(half.interface_dofs.points[half.sets["r.north"]], [[x, 3, 0] for x in range(3, 7)])


def beams(count: int, elements: int, how: Mapping[int, str]) -> tuple[dict[str, fs.Substructure], list[fs.Rigid]]:
    parts = {f"b{i}": fs.beam(1.0 / count, elements, **STEEL, interface=["left", "right"][i == 0:], ports={"tip": "right"},
                              supports={"left": "clamped"} if i == 0 else None) for i in range(count)}
    parts = {name: HOW[how.get(i, "full")](part) for i, (name, part) in enumerate(parts.items())}
    return parts, [fs.Rigid((f"b{i}", "right"), (f"b{i + 1}", "left"), tol=np.inf) for i in range(count - 1)]


@pytest.mark.parametrize("how", [{}, {0: "craig-bampton", 1: "craig-chang"}, {0: "craig-chang", 2: "craig-chang"},
                                 {0: "craig-chang", 1: "craig-chang", 2: "craig-chang", 3: "craig-chang"}])
def test_a_beam_of_beams_is_a_beam(how: dict[int, str]) -> None:
    parts, joints = beams(4, 3, how)
    agree(fs.couple(parts, joints), elastic(fs.beam(1.0, 12, **STEEL, supports={"left": "clamped"})))


MM = {"E": 2.1e5, "I": 1e4, "rho": 7.85e-9, "A": 100.0}  # the same steel in t, mm, s


@pytest.mark.parametrize("method", [None, fs.CraigBampton(4), fs.CraigChang(4), fs.DualCraigBampton(4), fs.MacNeal(4)])
def test_units_change_nothing(method: object) -> None:
    found = []
    for length, steel in ((1.0, STEEL), (1e3, MM)):
        parts = {"a": fs.beam(length, 8, **steel, supports={"left": "clamped"}, interface=["right"]),
                 "b": fs.beam(length, 10, **steel, interface=["left", "right"])}
        parts = parts if method is None else {name: fs.reduce(part, method) for name, part in parts.items()}
        found.append(fs.couple(parts, [fs.Rigid(("a", "right"), ("b", "left"), tol=np.inf)]))
    assert found[0].size == found[1].size and found[0].spurious == found[1].spurious
    modes = [fs.normal_modes(system, count=6).frequencies for system in found]
    np.testing.assert_allclose(modes[1], modes[0], rtol=1e-8)


def test_unsymmetric_damping_stays_unsymmetric() -> None:
    part = fs.chain(3, interface=[3]).with_damping(np.diag([0.1, 0.0], 1))
    system = fs.couple({"a": part, "b": fs.chain(2, interface=[1], fixed=False)}, [fs.Rigid(("a", [2]), ("b", [0]))])
    assert system.D[0, 1] == 0.1 and system.D[1, 0] == 0.0 and not system.pencil.symmetric[1]


def test_the_cutoff_is_the_least() -> None:
    parts, joints, _ = cut(20, 2)
    made = {name: fs.reduce(part, fs.CraigBampton(3 + i), ports=True) for i, (name, part) in enumerate(parts.items())}
    assert fs.couple(made, joints).cutoff == min(part.cutoff for part in made.values()) < np.inf


# springs and the ground


@pytest.mark.parametrize("how", list(HOW))
def test_springs_between_parts_are_the_springs_of_the_chain(how: str) -> None:
    whole = fs.chain(9, springs=np.linspace(1, 2, 9))
    left = fs.chain(4, springs=np.linspace(1, 2, 9)[:4], interface=[4], damping=0.0)
    right = fs.chain(5, belt=1, springs=np.linspace(1, 2, 9)[4:], interface=[1], fixed=False, damping=0.0)
    k = float(np.linspace(1, 2, 9)[4])
    parts = {"l": HOW[how](left), "r": HOW[how](right)}
    system = fs.couple(parts, [fs.Spring(("l", [3]), ("r", "belt"), stiffness=k, damping=0.2),
                               fs.Spring(("l", [3]), damping=[[0.1]])])
    agree(system, elastic(whole))
    u = system.expand(np.eye(9))
    d = u["l"][3] - u["r"][0]
    np.testing.assert_allclose(system.D.toarray() if sp.issparse(system.D) else system.D,
                               0.2 * np.outer(d, d) + 0.1 * np.outer(u["l"][3], u["l"][3]), atol=1e-12)
    assert len(system.interface) == 2  # springs take no DOF


@pytest.mark.parametrize("how", list(HOW))
def test_the_ground_holds(how: str) -> None:
    whole = fs.beam(1.0, 8, **STEEL, supports={"left": "clamped", "right": "clamped"})
    part = HOW[how](fs.beam(1.0, 8, **STEEL, supports={"left": "clamped"}, interface=["right"]))
    held = fs.couple({"b": part}, [fs.Rigid(("b", "right"), "ground")])
    agree(held, elastic(whole), 2e-9)
    assert not len(held.interface)
    np.testing.assert_allclose(held.expand(np.eye(held.size))["b"][-2:], 0.0, atol=1e-10)
    soft = fs.couple({"b": part}, [fs.Spring(("b", "right"), stiffness=np.diag([3e3, 50.0]))])
    reference = fs.beam(1.0, 8, **STEEL, supports={"left": "clamped"})
    K = reference.K.toarray()
    K[[-2, -1], [-2, -1]] += [3e3, 50.0]
    np.testing.assert_allclose(np.sqrt(elastic(soft)), np.sqrt(la.eigh(K, reference.M.toarray(), eigvals_only=True)), rtol=2e-9)


def test_parts_on_springs_keep_their_matrices() -> None:
    """Where nothing is joined but by springs, the system's matrices are those of the parts, to the last digit."""
    parts = {"a": lattice(9, 8, held=True), "b": lattice(7, 9)}
    system = fs.couple(parts, [fs.Spring(("a", [1]), ("b", [0]), stiffness=3.0), fs.Spring(("b", [1]), damping=0.5)])
    n, size = parts["a"].size, parts["a"].size + parts["b"].size
    r = sp.csr_array(([1.0, -1.0], ([0, 0], [1, n])), shape=(1, size))
    damper = sp.csr_array(([0.5], ([n + 1], [n + 1])), shape=(size, size))
    for key, extra in {"M": None, "K": 3.0 * (r.T @ r), "D": damper}.items():
        whole = sp.block_diag([getattr(part, key) for part in parts.values()], format="csr")
        assert ((whole if extra is None else whole + extra) != getattr(system, key)).nnz == 0


def test_a_spring_takes_no_side() -> None:
    parts = {"a": fs.beam(1.0, 3, **STEEL, interface=["left", "right"]), "b": fs.beam(1.0, 4, **STEEL, interface=["left"])}
    k = np.array([[2e3, 40.0], [40.0, 10.0]])
    one, other = (fs.couple(parts, [fs.Spring(*ends, stiffness=k, tol=1.5)]) for ends in
                  itertools.permutations([("a", "right"), ("b", "left")]))
    assert not (one.K != other.K).nnz
    d = np.zeros(one.size)
    d[6:8], d[8:10] = (1.0, 0.5), (0.2, 0.1)
    relative = d[6:8] - d[8:10]
    bare = sp.block_diag([part.K for part in parts.values()])
    assert d @ (one.K @ d) - d @ (bare @ d) == pytest.approx(relative @ k @ relative)


def test_a_joint_of_your_own_is_one_class() -> None:
    from femsub.coupling.joints import Joint, Link

    class Lever(Joint):
        """u_a = -2 u_b."""

        def link(self, parts: Mapping[str, fs.Substructure]) -> Link:
            return Link({"a": np.array([[1.0]]), "b": np.array([[2.0]])})

    parts = {"a": fs.chain(3, interface=[3]), "b": fs.chain(4, interface=[1], fixed=False)}
    system = fs.couple(parts, [Lever()])
    u = system.expand(np.eye(6))
    np.testing.assert_allclose(u["a"][2], -2 * u["b"][0])
    M, K = (sum(u[name].T @ getattr(part, key) @ u[name] for name, part in parts.items()) for key in "MK")
    np.testing.assert_allclose(system.K.toarray(), K, atol=1e-14)
    np.testing.assert_allclose(system.M.toarray(), M, atol=1e-14)


# what cannot be joined


def three() -> dict[str, fs.Substructure]:
    return {"disc": fs.beam(1.0, 3, **STEEL, interface=["left", "right"], ports={"tip": "right"}),
            "pad": fs.beam(1.0, 3, **STEEL, interface=["left"]), "arm": fs.chain(4, interface=[1, 4])}


WELD = fs.Rigid(("disc", "left"), ("pad", "left"))


@pytest.mark.parametrize(("joints", "words"), [
    ([WELD], "the part 'arm' is joined to nothing"),
    ([], "the part 'disc' is joined to nothing"),
    ([WELD, fs.Rigid(("arm", [0]), ("plate", "left"))], "unknown part 'plate'; did you mean 'pad'"),
    ([fs.Rigid(("disc", "middle"), ("pad", "left"))],
     r"Rigid\(disc.middle, pad.left\): unknown interface set of 'disc' 'middle'"),
    ([fs.Rigid(("disc", "right"), ("pad", "left"))],
     r"disc.right and pad.left do not meet at w at node 4 of 'disc': .* is 1 away"),
    ([fs.Rigid(("disc", [2]), ("arm", [0]))], "DOF 2 of 'disc' is no interface DOF"),
    ([fs.Rigid(("disc", "left"), ("arm", [0]))], r"disc.left has 2 DOF, but arm\[0\] 1"),
    ([fs.Rigid(("disc", "left"), ("disc", "left"))], "disc.left is joined to itself"),
    ([fs.Rigid(("disc", [0, 0]), ("arm", [0, 3]))], "lists a DOF of 'disc' twice"),
    ([fs.Rigid(("disc", [0.5]), ("arm", [0]))], "must list whole numbers"),
    ([fs.Rigid("disc", ("arm", [0]))], "an end must be"),
    ([fs.Spring(("disc", "tap"), ("arm", "belt"), stiffness=1.0)],
     "unknown port or interface set of 'disc' 'tap'; did you mean 'tip'"),
    ([fs.Spring(("disc", "tip"), ("pad", "left"), stiffness=1.0)], "disc.tip has 1 motions, but pad.left 2"),
    ([fs.Spring(("disc", "tip"), ("arm", "belt"), stiffness=np.eye(2))], "the stiffness is 2 x 2, but disc.tip has 1 motions"),
    ([WELD, fs.Spring(("arm", "belt"), stiffness=1.0)], "no joints lead from 'disc' to 'arm'"),
    (["weld"], "each of joints must be a Joint"),
])
def test_what_cannot_be_joined_is_named(joints: list, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words) as caught:
        fs.couple(three(), joints)
    assert isinstance(caught.value, fs.FemsubError)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: fs.Rigid(("disc", "left")), "two or more ends"),
    (lambda: fs.Rigid("ground", "ground"), "joins the ground to itself"),
    (lambda: fs.Rigid(("a", "b"), "ground", tol=0.0), "tol must be positive"),
    (lambda: fs.Spring(("a", "b")), "needs a stiffness or a damping"),
    (lambda: fs.Spring("ground", ("a", "b"), stiffness=1.0), "the ground is the second"),
    (lambda: fs.Spring(("a", "b"), stiffness=-1.0), "must not be negative"),
    (lambda: fs.Spring(("a", "b"), stiffness=[[1.0, 2.0], [0.0, 1.0]]), "must be symmetric"),
    (lambda: fs.Spring(("a", "b"), stiffness=[1.0, 2.0]), "a number or a square matrix"),
    (lambda: fs.couple({}, []), "parts is empty"),
    (lambda: fs.couple({"a.b": fs.chain(3)}, []), "without a dot"),
    (lambda: fs.couple({"a": None}, []), "the part 'a' must be a Substructure"),
    (lambda: fs.couple([fs.chain(3)], []), "parts must be a dict"),
    (lambda: fs.couple({"a": fs.chain(1, interface=[1])}, [fs.Rigid(("a", [0]), "ground")]), "leave nothing to move"),
    (lambda: fs.Substructure(np.eye(2), np.eye(2), interface={"a": [0, 2]}), "interface DOF 2 is out of range"),
    (lambda: fs.Substructure(np.eye(2), np.eye(2), interface=[0], sets={"a": [1]}), "but the interface has 1 DOF"),
])
def test_what_is_no_joint_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words) as caught:
        make()
    assert isinstance(caught.value, fs.FemsubError)


def test_an_interface_richer_than_its_part_is_told() -> None:
    """Two parts of one shape each, joined at four DOF: nothing is left that both can do."""
    mesh = fs.rectangle((1.0, 1.0), (2, 2))
    plates = [fs.plate(mesh, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, supports={"left": "clamped"}, interface=["right"])
              for _ in (0, 1)]
    parts = {name: fs.ReducedSubstructure(
        np.eye(2), np.diag([1.0, 2.0]), None, {}, name, V=np.random.default_rng(i).standard_normal((plate.size, 2)),
        kinds=("free",) * 2, full_interface=plate.interface, cutoff=2.0, method="modes",
        full_dofs=plate.dofs, sets=plate.sets) for i, (name, plate) in enumerate(zip("ab", plates, strict=True))}
    with pytest.raises(fs.InputError, match=r"Rigid\(a.right, b.right\): the 12 equations leave no motion to the 4 coordinates"):
        fs.couple(parts, [fs.Rigid(("a", "right"), ("b", "right"))])


def test_an_interface_that_stays_spread_can_be_joined_further() -> None:
    """A part of two shapes with 12 interface DOF: no coordinates of it are these, and a full part's DOF follow it."""
    mesh = fs.rectangle((1.0, 1.0), (2, 2))
    plate = fs.plate(mesh, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, supports={"left": "clamped"}, interface=["right"])
    modes = fs.normal_modes(plate, count=2)
    shapes = fs.ReducedSubstructure(
        np.eye(2), np.diag(modes.eigenvalues), None, {}, "shapes", V=modes.shapes, kinds=("free",) * 2,
        full_interface=plate.interface, cutoff=2.0, method="modes", full_dofs=plate.dofs, sets=plate.sets)
    spring, weld = fs.Spring(("s", "right"), stiffness=10.0), fs.Rigid(("s", "right"), ("p", "right"))
    inner = fs.couple({"s": shapes}, [spring])
    assert not len(inner.interface) and inner.interface_rows.shape == (12, 2) and set(inner.sets) == {"s.right"}
    outer = fs.couple({"in": inner, "p": plate}, [fs.Rigid(("in", "s.right"), ("p", "right"))])
    direct = fs.couple({"s": shapes, "p": plate}, [spring, weld])
    assert outer.size == direct.size == plate.size - 12 + 2
    np.testing.assert_allclose(elastic(outer), elastic(direct), rtol=1e-9)
    with pytest.raises(fs.InputError, match="no interface DOF"):
        fs.couple({"in": inner, "p": plate}, [fs.Rigid(("in", [0]), ("p", [0]))])


@pytest.mark.parametrize("how", list(HOW))
def test_a_part_joined_to_itself_is_a_ring(how: str) -> None:
    n = 12
    part = HOW[how](fs.chain(n + 1, masses=[0.5] + [1.0] * (n - 1) + [0.5], interface=[1, n + 1], fixed=False))
    ring = np.sort(2 * np.sin(np.pi * np.arange(n) / n))
    found = fs.couple({"a": part}, [fs.Rigid(("a", [0]), ("a", [n]))])
    np.testing.assert_allclose(np.sqrt(np.abs(elastic(found)))[1:], ring[1:], rtol=1e-9)
    # a stiff spring instead: nearly so, and as one more DOF
    found = fs.couple({"a": part}, [fs.Spring(("a", [0]), ("a", [n]), stiffness=1e9)])
    np.testing.assert_allclose(np.sqrt(np.abs(elastic(found)))[1:n], ring[1:], rtol=1e-6)


def test_a_product_is_sparse_if_both_are(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interfaces that Craig-Chang spreads over all coordinates made `couple` ten times as slow as its arithmetic."""
    full, thin = rng.standard_normal((9, 9)), np.diag(np.arange(1.0, 10.0))
    for A in (full, thin):
        for B in (full, thin):
            for left in (A, sp.csr_array(A)):
                for right in (B, sp.csr_array(B)):
                    found = product(left, right)
                    assert sp.issparse(found) == (sp.issparse(left) and sp.issparse(right))
                    np.testing.assert_allclose(found.toarray() if sp.issparse(found) else found, A @ B, rtol=1e-13)
    filled, sparse = sp.csr_array(full), sp.csr_array(thin)
    monkeypatch.setattr(sp.csr_array, "__matmul__", None)  # no sparse product where both are filled
    assert product(filled, filled).nnz == 81
    with pytest.raises(TypeError):
        product(filled, sparse)


def test_joints_that_lock_a_complete_part_are_no_error() -> None:
    parts = {"a": fs.chain(3, interface=[3]), "b": fs.chain(2, interface=[1, 2], fixed=False)}
    joints = [fs.Rigid(("a", [2]), ("b", [0])), fs.Rigid(("b", [1]), "ground"), fs.Rigid(("b", [0]), "ground")]
    complete = {"a": fs.reduce(parts["a"], fs.CraigChang(3)), "b": fs.reduce(parts["b"], fs.CraigChang(1))}
    found = [fs.couple(those, joints) for those in (complete, parts)]
    np.testing.assert_allclose(*(elastic(system) for system in found), rtol=1e-9)


def test_joining_takes_as_many_steps_as_there_are_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """No joint makes a matrix for each part of the system."""
    made = []
    begin = sp.csr_array.__init__
    monkeypatch.setattr(sp.csr_array, "__init__", lambda self, *given, **how: made.append(1) or begin(self, *given, **how))

    def steps(pieces: int) -> int:
        parts, joints, _ = cut(10 * pieces, pieces)
        made.clear()
        fs.couple(parts, joints)
        return len(made)

    few, more, most = steps(10), steps(20), steps(40)
    assert most - more <= 2.1 * (more - few)


def test_parts_with_spread_interfaces_in_a_row_are_joined_to_their_neighbours_alone() -> None:
    """Each part moves with its own coordinates and the two interfaces; else a row of n parts would cost n³."""
    ends = {0: [12], 7: [1]}
    parts = {f"c{i}": fs.chain(12, belt=12 if i < 7 else 1, interface=ends.get(i, [1, 12]), fixed=not i) for i in range(8)}
    joints = [fs.Rigid((one, [11]), (other, [0])) for one, other in itertools.pairwise(parts)]
    spread = {name: fs.reduce(part, fs.CraigChang(4)) for name, part in parts.items()}
    joined, physical = fs.couple(spread, joints), fs.couple({n: fs.reduce(p, fs.Rubin(4)) for n, p in parts.items()}, joints)
    starts = np.cumsum([0, *(part.size for part in spread.values())])
    for begin, end in itertools.pairwise(starts):
        assert np.count_nonzero(np.abs(joined.L[begin:end]).max(axis=0)) == end - begin
    agree(joined, elastic(physical), 1e-11)
