"""The contact table of a scene."""

from typing import Any

from taichisoft_sofa.components.contact_components import distances_of, friction_of
from taichisoft_sofa.components.draft import SceneDraft

NEEDED = ("pipeline", "broad phase", "response")
SPACING = 0.8
"""Distance below which only one of two contacts is kept, as a fraction of the alarm distance [-]."""


def collides(draft: SceneDraft) -> bool:
    """Whether the scene detects and solves contacts."""
    return draft.free_motion and all(role in draft.pipeline for role in NEEDED)


def contact_table(draft: SceneDraft) -> dict[str, Any]:
    """Friction and distances; without collisions the engine's defaults."""
    if not collides(draft):
        return {}
    draft.depart(
        "contact: bodies slide by the whole of their free motion, of which SOFA drops the tangential part where they "
        "separate; contacts are solved until they change by less than 1e-5 mm/s, whatever tolerance the scene gives"
    )
    table: dict[str, Any] = {"friction": friction_of(draft.pipeline["response"], draft)}
    if "distance" in draft.pipeline:
        alarm, contact = distances_of(draft.pipeline["distance"])
        table |= {"alarm_distance": alarm, "contact_distance": contact, "spacing": SPACING * alarm}
    return table
