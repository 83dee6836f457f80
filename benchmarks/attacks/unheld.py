"""Parts under friction, some with a forgotten spring: refused if friction drives a rigid motion, and only then.

The reference is the rigid motion of both bodies, six numbers each. The places of the contact's corners show which motions
supports, springs and the contact's normal do not resist, and which of these slide along the friction. A slide or disc that is
free to keep moving is no forgotten spring. If nothing is refused, the number of eigenvalues at 0 must follow from the geometry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, null_space

KINDS = ("straight", "turning", "ground")
RANK = 1e-8  # singular values in units of length below which they are 0
SLOW = 1e-5  # share of an elastic frequency below which a growing eigenvalue is rounding


@attack("unheld", KINDS)
def attacked(kind: str, random: Random) -> str:
    """'refused' if a spring is forgotten, otherwise the evidence; or a text that begins with 'wrong'."""
    model, contact, left, driven, damped = _case(random, kind)
    told = f"{driven} driven of {left}"
    words = []
    form = str(random.choice(["contact modes", "part by part", "coarse"]))
    models = {"full": model}
    if form == "contact modes":
        models[form] = fs.reduce(model, fs.ContactModes(6, contacts=contact))
    elif isinstance(model, fs.System):
        methods = {name: fs.CraigChang(4) if form == "coarse" else fs.Rubin(4) for name in model.parts}
        models[form] = fs.reduce(model, methods, ports=True)
    top = 1.5 * float(fs.normal_modes(model, count=3).frequencies[-1])
    for name, one in models.items():
        limit = min(one.cutoff, top)
        for mu in (0.0, contact.mu):
            acting = replace(contact, mu=mu)
            try:
                modes = fs.complex_modes(one, acting, band=(0.0, limit))
            except fs.InputError as error:
                if "is not supported" not in str(error):
                    return f"refused by another reason: {told}, {name}: {error}"
                if not (mu and driven):
                    return f"wrong: {told}, {name}, mu = {mu}: {error}"
                words.append("refused")
                continue
            except (fs.NotConvergedError, fs.MissedModesError, fs.SingularMatrixError) as error:
                return f"refused by another reason: {told}, {name}: {error}"
            if mu and driven:
                return f"wrong: {told}, {name}: not refused: {modes!r}"
            zeros = left * (1 if damped else 2)
            if modes.rigid.sum() != zeros and modes.evidence == "certified":
                return f"wrong: {told}, {name}, mu = {mu}: {modes.rigid.sum()} at 0 for {zeros}, {modes!r}"
            slow = modes.eigenvalues[modes.unstable]
            if len(slow) and np.abs(slow).min() < SLOW * top:
                return f"wrong: {told}, {name}, mu = {mu}: rounding grows: {modes!r}"
            words.append(modes.evidence)
        if driven or (left and name != "full" and one.size <= 300):
            try:
                found = fs.critical_value(one, contact, "mu", between=(0.0, 0.5), band=(0.0, limit))
                return f"wrong: {told}, {name}: {found!r}"
            except fs.InputError as error:
                if not any(word in str(error) for word in ("is not supported", "floats")):
                    return f"wrong: {told}, {name}: {error}"
    return next((word for word in ("refused", "not checked", "confirmed") if word in words), "certified")


def _case(random: Random, kind: str) -> tuple[fs.Substructure, fs.FrictionContact, int, int, bool]:
    """The model, its contact, the number of rigid motions left, how many of them friction drives, and whether D contains αM."""
    scale = 10.0 ** random.uniform(-2, 2)
    steel = fs.Material(10.0 ** random.uniform(7, 12), 0.3, 10.0 ** random.uniform(2, 4))
    a, b = random.uniform(0.02, 0.05, 2) * scale
    cells = (int(random.integers(1, 3)), int(random.integers(1, 3)), 1)
    body = fs.block((a, b, 0.01 * scale), cells, "hexahedron")
    at = np.array([random.uniform(0.0, 0.04), random.uniform(0.0, 0.04), 0.01]) * scale
    meshes = {"pad": fs.Mesh(body.points + at, body.cells, body.kind, sets=body.sets),
              "slide": fs.block((0.1 * scale, 0.1 * scale, 0.01 * scale), (3, 2, 2), "hexahedron")}
    damped = bool(random.random() < 0.5)
    rayleigh = (1e-3 * np.sqrt(steel.E / steel.rho) / scale * damped, 1e-9 * scale / np.sqrt(steel.E / steel.rho))
    sets = ("left", "right", "front", "back", "top")
    pad = fs.solid(meshes["pad"], steel, interface=["bottom"], rayleigh=rayleigh,
                   ports={f"{place}-{axis}": (place, axis) for place in sets for axis in "xyz"})
    held = str(random.choice(["xyz", "xyz", "yz", "z", "xz"]))
    slide = fs.solid(meshes["slide"], steel, interface=["top"], rayleigh=rayleigh,
                     ports={f"top-{axis}": ("top", axis) for axis in "xyz"}, supports={"bottom": held})
    turning = kind == "turning"
    centre = np.array([0.05, 0.05, 0.0]) * scale if random.random() < 0.5 else np.array([-0.1, 0.2, 0.0]) * scale
    angle = random.choice([0.0, np.pi / 2, random.uniform(0, 2 * np.pi)])
    way = {"axis": (0, 0, 1), "centre": centre} if turning else {"direction": (np.cos(angle), np.sin(angle), 0.0)}
    mu = float(random.uniform(0.01, 0.3))
    contact = fs.FrictionContact("pad.bottom", "ground" if kind == "ground" else "slide.top", meshes, steel.E / scale, mu, **way)
    # springs: along some axes at the means of some sets
    parts = ("pad",) if kind == "ground" else ("pad", "slide")
    springs = [(part, str(place), axis) for part, chance in zip(parts, (0.85, 0.15), strict=False)
               for place in (random.permutation(sets)[:int(random.integers(0, 4))] if part == "pad" else ["top"])
               for axis in "xyz" if random.random() < chance]
    stiffness = steel.E * scale * 10.0 ** random.uniform(-4, 0)
    joints = [contact, *(fs.Spring((part, f"{place}-{axis}"), "ground", stiffness=stiffness) for part, place, axis in springs)]
    model = fs.couple({name: {"pad": pad, "slide": slide}[name] for name in parts}, joints)
    # geometry, in units of the scale: u = t + θ × (x - at)
    origin = {name: mesh.points.mean(axis=0) for name, mesh in meshes.items()}

    def row(part: str, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The motion of points along a direction, (k, 12)."""
        r = (np.atleast_2d(points) - origin[part]) / scale
        own = np.hstack([np.tile(direction, (len(r), 1)), np.cross(r, direction)])
        return np.hstack([own, 0 * own] if part == "pad" else [0 * own, own])

    rows = [row(part, meshes[part].points[meshes[part].sets[place]].mean(axis=0), np.eye(3)["xyz".index(axis)])
            for part, place, axis in springs]
    bottom = meshes["slide"].points[meshes["slide"].sets["bottom"]]
    rows += [row("slide", bottom, np.eye(3)["xyz".index(axis)]) for axis in ("xyz" if kind == "ground" else held)]
    corners = meshes["pad"].points[meshes["pad"].sets["bottom"]]
    corners = corners[(corners[:, :2] <= 0.1 * scale * (1 + 1e-9)).all(axis=1)]
    inside = [*corners, corners.mean(axis=0), 0.3 * corners[0] + 0.7 * corners.mean(axis=0)]
    press = [row("pad", x, np.array([0, 0, 1.0])) - row("slide", x, np.array([0, 0, 1.0])) for x in inside]
    loose = null_space(np.vstack([*rows, *press]), np.eye(12), RANK)
    along = [np.cross([0, 0, 1.0], x - centre) if turning else np.array([np.cos(angle), np.sin(angle), 0.0]) for x in inside]
    along = [t / np.linalg.norm(t) for t in along]
    slips = np.vstack([row("pad", x, t) - row("slide", x, t) for x, t in zip(inside, along, strict=True)])
    # steady sliding: the slide's own motion along the sliding direction, if it is free
    spin = np.cross([0, 0, 1.0], origin["slide"] - centre) / scale
    own = np.concatenate([np.zeros(6), spin if turning else along[0], [0, 0, 1.0] if turning else np.zeros(3)])[:, None]
    free = own if kind != "ground" and np.abs(np.vstack([*rows, *press]) @ own).max() < RANK else own[:, :0]
    quiet = np.hstack([null_space(slips, loose, RANK), free])
    return model, contact, loose.shape[1], loose.shape[1] - np.linalg.matrix_rank(quiet, tol=1e-6), damped
