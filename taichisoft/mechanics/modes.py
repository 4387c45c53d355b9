"""The modes of a reduced soft body: a file that `taichisoft reduce` writes, and that a scene names."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base.files import atomic_file, read_arrays
from taichisoft.errors import SceneError

# How far the nodes of a mesh may be from those of the file, over the size of the body.
SAME_MESH = 1e-6
# How far the modes' products in the mass may be from 0 and 1.
ORTHONORMAL = 1e-6
REMEDY = "reduce the scene again"


@dataclass(frozen=True)
class Modes:
    """Displacements of a body's nodes in the frame of its mesh, by whose amplitudes it moves.

    Attributes:
        rest_position: nodes of the mesh in its own frame [mm], shape (node_count, 3).
        modes: displacements by an amplitude of 1, orthonormal in the lumped mass: sum m phi_i phi_j = delta_ij
            [1 / sqrt(kg)], shape (node_count, 3, mode_count).
        domain: numbers of the integration domains that stand for all, in the order of the body's elements or of the
            `IntegrationDomains` of its kind, shape (count,); None: all of them.
        weight: factors of their volumes [-], above 0, shape (count,); None: 1.
        amplitude_range: smallest and largest amplitudes of the training [mm sqrt(kg)], shape (mode_count, 2); None:
            not known.
        fingerprint: `SoftBody.fingerprint` of the body: its element, laws, and ratios of moduli.
        tolerance: requested relative error [-]; None: not known.
        error: relative error that the validation found [-]; None: not known.
        imbalance: largest imbalance in the validation [mm], see `step/divergence.py`; None: not known.
        error_per_imbalance: largest error of a position over the largest imbalance of a run [-], the largest of runs;
            None: not known.
        pressed: whether something pressed a node in the training, shape (node_count,); None: not known.
        drives: by actuator, without the body's name, the key of `Control` that drove it in the training, and its
            smallest and largest value, as JSON; without those that are not known.
        report: figures of the validation, as JSON.
    """

    rest_position: np.ndarray
    modes: np.ndarray
    domain: np.ndarray | None = None
    weight: np.ndarray | None = None
    amplitude_range: np.ndarray | None = None
    fingerprint: str = ""
    tolerance: float | None = None
    error: float | None = None
    imbalance: float | None = None
    error_per_imbalance: float | None = None
    pressed: np.ndarray | None = None
    drives: str = "{}"
    report: str = "{}"

    @property
    def mode_count(self) -> int:
        """Number of modes."""
        return int(self.modes.shape[2])

    def write(self, path: Path) -> None:
        """Write the file.

        Raises:
            TaichisoftError: it cannot be written.
        """
        given = {name: value for name, value in vars(self).items() if value is not None}
        with atomic_file(path) as partial, partial.open("wb") as stream:
            np.savez(stream, **given)


def read_modes(path: Path, key: str) -> Modes:
    """Read a file of modes; `key` is the key of the scene that names it."""
    where = f"{key}: {path}"
    try:
        found = read_arrays(path)
    except (OSError, ValueError) as error:
        raise SceneError(f"{where}: is not a file of modes, as `taichisoft reduce` writes it: {error}") from error
    missing = [name for name in ("rest_position", "modes") if name not in found]
    if missing:
        raise SceneError(f"{where}: has no array '{missing[0]}'; {REMEDY}")
    place = _numbers(found, "rest_position", (-1, 3), where)
    basis = _numbers(found, "modes", (len(place), 3, -1), where)
    shapes = {
        "domain": (-1,),
        "weight": np.shape(found.get("domain", ())),
        "amplitude_range": (basis.shape[2], 2),
        "pressed": (len(place),),
    } | dict.fromkeys(("tolerance", "error", "imbalance", "error_per_imbalance"), ())
    given: dict[str, Any] = {n: _numbers(found, n, shape, where) for n, shape in shapes.items() if n in found}
    for name, value in given.items():
        if not shapes[name]:
            given[name] = value.item()
    if "domain" in given:
        given["domain"] = given["domain"].astype(np.int64)
    if "pressed" in given:
        given["pressed"] = given["pressed"] > 0.0
    given |= {name: str(found[name]) for name in ("fingerprint", "drives", "report") if name in found}
    modes = Modes(place, basis, **given)
    if not 0 < modes.mode_count <= 3 * len(modes.rest_position):
        raise SceneError(f"{where}: has {modes.mode_count} modes; must be 1 to {3 * len(modes.rest_position)}")
    if modes.weight is not None and not (modes.weight > 0.0).all():
        raise SceneError(f"{where}: weight {modes.weight.min():g} of a domain; must be above 0")
    try:
        json.loads(modes.report)
    except ValueError as error:
        raise SceneError(f"{where}: its report is not JSON: {error}") from error
    try:
        for key, low, high in json.loads(modes.drives).values():
            str(key), float(low), float(high)
    except (ValueError, TypeError, AttributeError) as error:
        raise SceneError(f"{where}: its drives are not key, low and high by actuator: {error}; {REMEDY}") from error
    return modes


def _numbers(found: dict[str, np.ndarray], name: str, shape: tuple[int, ...], where: str) -> np.ndarray:
    """An array of finite numbers of a shape, in which -1 is any number."""
    array = found[name]
    fits = array.ndim == len(shape) and all(want in (-1, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "fiub":
        expected = ", ".join("any" if size < 0 else str(size) for size in shape)
        raise SceneError(f"{where}: {name} has shape {array.shape} of {array.dtype}; must be numbers of ({expected})")
    array = np.ascontiguousarray(array, dtype=np.float64)
    if not np.isfinite(array).all():
        raise SceneError(f"{where}: {name} has a value that is not finite; {REMEDY}")
    return array


def check_modes(modes: Modes, path: str, key: str, body: Any, domain_count: int) -> None:
    """Refuse modes of another mesh, of other materials or masses, or of a body that modes cannot move."""
    where, nodes = f"{key}: {path}", body.mesh.nodes
    if len(modes.rest_position) != len(nodes):
        raise SceneError(
            f"{where}: was made of a mesh with {len(modes.rest_position)} nodes, {body.mesh.source} has {len(nodes)}; "
            f"{REMEDY}"
        )
    away = float(np.abs(modes.rest_position - nodes).max())
    if away > SAME_MESH * float(np.ptp(nodes, axis=0).max()):
        raise SceneError(
            f"{where}: was made of another mesh: a node of {body.mesh.source} is {away:.3g} mm from where it was; "
            f"{REMEDY}"
        )
    if modes.fingerprint and modes.fingerprint != body.fingerprint:
        raise SceneError(
            f"{where}: was made of other materials ({modes.fingerprint}) than the body's ({body.fingerprint}); {REMEDY}"
        )
    flat = modes.modes.reshape(-1, modes.mode_count)
    products = flat.T @ (np.repeat(body.node_mass, 3)[:, None] * flat)
    off = float(np.abs(products - np.eye(modes.mode_count)).max())
    if off > ORTHONORMAL:
        raise SceneError(
            f"{where}: its modes are not orthonormal in the masses of the nodes (off by {off:.3g}): the body has "
            f"another mass or density; {REMEDY}"
        )
    numbers = modes.domain
    if numbers is not None and len(numbers) and not 0 <= numbers.min() <= numbers.max() < domain_count:
        raise SceneError(f"{where}: has domain {numbers.max()}, the body has {domain_count}; {REMEDY}")
    if numbers is not None and not len(numbers):
        raise SceneError(f"{where}: has no integration domains; {REMEDY}")
    if not body.anchored.any():
        raise SceneError(f"{key}: the body has no anchors; only a body that its anchors hold can move by modes")
    if body.settings.corotation != "polar":
        raise SceneError(f'{key}: needs corotation = "polar", not "{body.settings.corotation}"')
