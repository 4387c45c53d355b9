"""Springs between two points, of one mechanical object or of two."""

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.draft import DraftSpring
from taichisoft_sofa.components.frames import FramePoses, composed, local_position, start_values
from taichisoft_sofa.components.graph import STATE, TOPOLOGIES, inputs_of, linked_state, mapping_of, nearest, node_of
from taichisoft_sofa.components.states import start_position
from taichisoft_sofa.components.typed_values import computed, described, flag, is_given, number, numbers, text
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

STIFFNESS, DAMPING = 100.0, 5.0
"""SOFA's defaults of springs that are given one by one [mN/mm] and [mN s/mm]."""
MOST = 500
"""Largest number of springs of a scene: each is a row of the constraint solver."""
CELLS = {"lines": ("edges", 2), "triangles": ("triangles", 3), "quads": ("quads", 4)}
CELLS |= {"tetrahedra": ("tetrahedra", 4), "tetras": ("tetrahedra", 4), "cubes": ("hexahedra", 8)}
"""Kinds of cells whose corners springs of a mesh join, with their number of corners."""


def single_springs(component: "Component", draft: "SceneDraft") -> None:
    """Translate springs that are listed: by `spring`, rows of two indices, stiffness, damping and length at rest, or by
    `indices1` and `indices2`."""
    ends = _ends(component)
    rows = numbers(component, "spring", "springs")
    if rows.size % 5:
        raise SceneError(f"{described(component)}: spring has {rows.size} numbers; they are not rows of five")
    rows = rows.reshape(-1, 5)
    if not len(rows):
        first, second = (numbers(component, f"indices{end}").astype(np.int64) for end in (1, 2))
        if len(first) != len(second):
            raise SceneError(f"{described(component)}: indices1 has {len(first)} points, indices2 {len(second)}")
        lengths = numbers(component, "lengths", "length")
        if len(lengths) not in (len(first), 1):
            lengths = np.array([]) if not len(lengths) else lengths[:1]
        given = np.broadcast_to(lengths, len(first)) if len(lengths) else np.full(len(first), np.nan)
        each = (number(component, "stiffness", default=STIFFNESS), number(component, "damping", default=DAMPING))
        rows = np.column_stack([first, second, *(np.full(len(first), value) for value in each), given])
    damped = False
    for one, other, stiffness, damping, length in rows.tolist():
        damped |= damping > 0.0
        _add(component, draft, ends, (int(one), int(other)), stiffness, length)
    _note_damping(component, draft, damped)


def mesh_springs(component: "Component", draft: "SceneDraft") -> None:
    """Translate springs along edges and across cells of a topology; their stiffness is by relative stretch."""
    ends = _ends(component)
    link = text(component, "topology")
    topology = component.linked("topology") if link else nearest(node_of(component), TOPOLOGIES)
    if topology is None:
        draft.refuse(component, "finds no topology in its node or above")
        return
    done: set[tuple[int, int]] = set()
    damped = False
    for name, (kind, corners) in CELLS.items():
        modulus = number(component, f"{name}Stiffness", "stiffness", default=0.0)
        damped |= number(component, f"{name}Damping", "damping", default=0.0) > 0.0
        for cell in computed(topology, kind, corners).tolist() if modulus > 0.0 else ():
            for pair in combinations(cell, 2):
                if (key := (min(pair), max(pair))) not in done:
                    done.add(key)
                    _add(component, draft, ends, key, modulus, np.nan, relative=True)
    _note_damping(component, draft, damped)


def _ends(component: "Component") -> "tuple[Component, Component]":
    """The mechanical objects of the first and the second points: linked ones, else the one of the node."""
    own, found = nearest(node_of(component), {STATE}), []
    for name in ("object1", "object2"):
        links = component.linked_all(name) if is_given(component, name) else []
        state = linked_state(component, *links[0]) if links else own
        if state is None:
            raise SceneError(f"{described(component)}: finds no MechanicalObject in its node or above")
        found.append(state)
    return found[0], found[1]


def _add(
    component: "Component",
    draft: "SceneDraft",
    ends: "tuple[Component, Component]",
    points: tuple[int, int],
    stiffness: float,
    length: float,
    relative: bool = False,
) -> None:
    """Add a spring; without a length it is at rest, and with a relative stiffness that is by relative stretch."""
    places = []
    for state, point in zip(ends, points, strict=True):
        if not draft.has_points(component, np.array([point]), len(start_position(state))):
            return
        places.append(_place(state, point))
    distance = float(np.linalg.norm(places[1] - places[0]))
    if distance == 0.0:
        draft.refuse(component, f"joins points {points[0]} and {points[1]} at one place; a spring needs a length here")
        return
    if len(draft.springs) == MOST:
        draft.refuse(component, f"makes more than {MOST} springs; elements of a mesh are the way to have so many")
    if len(draft.springs) >= MOST or stiffness <= 0.0:
        return
    rest = distance if np.isnan(length) else length
    modulus = stiffness * distance if not relative else stiffness
    pushes = not flag(component, "noCompression", False)
    draft.springs.append(DraftSpring(component, ends, points, modulus, distance - rest, pushes))


def _place(state: "Component", point: int) -> np.ndarray:
    """Place of a point at the start [mm], also of one that is given in the axes of a frame."""
    mapping, local = mapping_of(state), local_position(state)[[point], :3]
    if mapping is not None and canonical(mapping.type_name) == "RigidMapping":
        local = composed(FramePoses(start_values).of(inputs_of(mapping)[0])[:1], local)
    found: np.ndarray = local[0]
    return found


def _note_damping(component: "Component", draft: "SceneDraft", damped: bool) -> None:
    if damped:
        draft.depart(f"{component.getPathName()}: its springs have no damping of their own here")
