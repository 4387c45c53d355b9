"""The parts of a finger that scenes name: groups of its tetrahedra and of its boundary triangles."""

import numpy as np

from taichisoft.errors import MeshError
from taichisoft_meshing.finger.boxes import TOUCH, stiff_layer_box
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.quality.mesh_surfaces import cavity_names, skins_and_cavities


def element_groups(finger: FingerParameters, nodes: np.ndarray, elements: np.ndarray) -> dict[str, np.ndarray]:
    """Groups of elements, each (count,) element indices.

    "silicone" has all. "stiff_layer" has those whose mean of nodes lies in the layer, as a box in a scene would select
    them: faces of the mesh along the layer's would be a fraction of a millimetre from the channel's, and the elements
    between them as flat. "base_block" has those that lie whole within body.base_length of the base; in an even mesh,
    which does not end there, there may be none.

    Args:
        finger: the dimensions.
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4).

    Raises:
        ValueError: no element lies in the stiff layer.
    """
    groups = {"silicone": np.arange(len(elements), dtype=np.int32)}
    layer = stiff_layer_box(finger)
    if layer is not None:
        groups["stiff_layer"] = _indices(layer.holds(nodes[elements].mean(axis=1)))
        if not len(groups["stiff_layer"]):
            raise ValueError(
                f"stiff_layer.thickness = {finger.stiff_layer.thickness:g}: no element has its middle in the layer; "
                f"must be larger, or 0 for none, or mesh.largest = {finger.mesh.largest:g} smaller"
            )
    held = nodes[:, 0] >= -finger.body.base_length - TOUCH
    base = _indices(held[elements].all(axis=1))
    return {**groups, "base_block": base} if len(base) else groups


def surface_groups(nodes: np.ndarray, elements: np.ndarray) -> dict[str, np.ndarray]:
    """Groups of boundary triangles of a body in one piece, each (count, 3) node indices.

    "outer" is closed and faces outward; "base" is the part of it in the plane x = 0. "cavity", or "cavity_0",
    "cavity_1", ... from the base on where there are several, are closed and face into the silicone, so that the
    volumes that they enclose are positive.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4).

    Raises:
        MeshError: the boundary has several outer skins, or none.
    """
    skins, cavities = skins_and_cavities(nodes, elements)
    if len(skins) != 1:
        raise MeshError(f"the body has {len(skins)} outer skins; it must be one piece of silicone")
    (outer,) = skins
    in_base = (np.abs(nodes[outer, 0]) < TOUCH).all(axis=1)
    cavities.sort(key=lambda cavity: -nodes[cavity, 0].max())
    names = cavity_names(len(cavities))
    return {"outer": outer, "base": outer[in_base], **dict(zip(names, cavities, strict=True))}


def _indices(chosen: np.ndarray) -> np.ndarray:
    return np.flatnonzero(chosen).astype(np.int32)
