"""docs/meshing.md: its files are valid, and its drawing names every dimension."""

import re
import runpy
import tomllib
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel

from taichisoft.command_line import application
from taichisoft.running.plugin_commands import with_plugin_commands
from taichisoft_meshing import checked
from taichisoft_meshing.file_bodies import StepTable, SurfacesTable
from taichisoft_meshing.finger_dimensions import FingerParameters
from taichisoft_meshing.geometry_file import quality_limits
from taichisoft_meshing.tendon_finger import TendonFingerTable

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "meshing.md").read_text(encoding="utf-8")
NOTE = DOCS / "notes" / "experiments.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def test_every_option_of_the_text_exists() -> None:
    """Of whole commands tests/test_docs.py."""
    groups = [group for name, group in with_plugin_commands(application).commands.items() if name in ("mesh", "new")]
    parts = [part for group in groups for one in (group, *group.commands.values()) for part in one.params]
    in_text = set(re.findall(r"`(--[a-z-]+)", PAGE)) - {"--clear", "--plugin"}
    assert in_text <= {option for part in parts for option in part.opts}


def test_every_file_of_the_page_is_valid() -> None:
    """Geometries of STEP files and surfaces, limits of quality, scenes."""
    tables = [tomllib.loads(block) for block in blocks("toml")]
    seen = set()
    for table in tables:
        if "quality" in table:
            assert quality_limits(table, DOCS).model_dump() == table["quality"]
            seen.add("quality")
        elif "kind" in table:
            kinds = {"step": StepTable, "surfaces": SurfacesTable, "tendon_finger": TendonFingerTable}
            kind = table.pop("kind")
            made = checked(kinds[kind], table, DOCS)
            assert kind != "tendon_finger" or made == TendonFingerTable()
            seen.add(kind)
    assert seen == {"quality", "step", "surfaces", "tendon_finger"}


def dimensions(table: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, field in table.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield from dimensions(inner, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def test_every_dimension_is_in_the_drawing(tmp_path: Path) -> None:
    """The shipped drawing has the texts of a new one; its lines may differ by the version of matplotlib."""
    runpy.run_path(str(DOCS / "pictures.py"))["draw_finger"](tmp_path / "finger.svg")
    drawn, shipped = [path.read_text(encoding="utf-8") for path in (tmp_path / "finger.svg", DOCS / "finger.svg")]
    texts = [re.findall(r"<text[^>]*>(.*?)</text>", svg) for svg in (drawn, shipped)]
    assert texts[0] == texts[1], "run: python docs/pictures.py finger"
    for key in dimensions(FingerParameters):
        if not key.startswith(("mesh.", "wall")):  # thicknesses of walls stand for positions that are drawn
            assert any(text.startswith(f"{key} = ") for text in texts[1]), key


def test_the_shares_of_the_limit_are_those_that_were_measured() -> None:
    """The guide's rows of smoothed elements are rows of the note's table, by their nodes."""
    rows = re.findall(r"^\| `--[^|]*\| (\d+) \| (\d) \| (\d+) %", PAGE, re.MULTILINE)
    assert len(rows) == 2
    for nodes, across, share in rows:
        assert re.search(rf"\| {nodes} \| \d+ \| {across} \| [\d.]+ \| {share}% \|", NOTE.read_text(encoding="utf-8"))
