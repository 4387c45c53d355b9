"""Planes of penalty forces as native planes, which do not give way, without friction."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.meshes import boundary_triangles
from taichisoft_sofa.translation.contact import collides

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.translation.parts import Translation

DISTANCE, ALARM = 0.01, 0.05
"""Contact distance and alarm distance of a scene without contacts, as shares of its smallest body's size [-]."""


def add_planes(draft: "SceneDraft", translation: "Translation") -> None:
    """Add the planes of a scene; they stand a contact distance behind where bodies stop."""
    if not draft.planes:
        return
    tables = translation.tables
    names = [translation.names.get(plane.body.state) for plane in draft.planes]
    if not collides(draft):
        sizes = [np.ptp(plane.body.position[:, :3], axis=0).min() for plane in draft.planes if not plane.body.rigid]
        size = float(min(sizes, default=100.0)) or 1.0
        tables["contact"] = {"friction": 0.0, "contact_distance": DISTANCE * size, "alarm_distance": ALARM * size}
    distance = tables.get("contact", {}).get("contact_distance", 1.0)
    group = 1 + max(
        (one for body in draft.bodies.values() for s in body.surfaces.values() for one in s.groups), default=0
    )
    for number, (plane, name) in enumerate(zip(draft.planes, names, strict=True)):
        body: dict[str, Any] = tables.get("soft_bodies", {}).get(name) or tables.get("rigid_bodies", {}).get(name, {})
        part = translation.soft.get(name or "")
        if name is None or (part is None and not body.get("collides")):
            draft.refuse(plane.component, "acts on a body without a surface; give it collision models")
            continue
        if part is not None and not body.get("collides", True):
            points = plane.body.position[part.points]
            skin = translation.files.surface(f"{name}-skin", points, boundary_triangles(part.elements))
            body |= {"collides": True, "collision_surface": [{"file": skin, "groups": [group + draft.own_groups]}]}
        own = f"plane{number}"
        place = ((plane.offset - distance) * plane.normal).tolist()
        tables.setdefault("obstacles", {})[own] = {"plane": {"point": place, "normal": plane.normal.tolist()}}
        tables["contact"].setdefault("pairs", []).append({"bodies": [name, own], "friction": 0.0})
        draft.depart(f"{plane.component.getPathName()}: does not give way; in SOFA by force over stiffness")
    if len(tables.get("soft_bodies", {})) + len(tables.get("rigid_bodies", {})) > len(set(names)):
        draft.depart("planes: are there for all bodies that collide")
