"""report.html: one file with everything that a run has left, and what it has not left is said."""

import base64
import json
import os
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

import fake_run
import numpy as np
import pytest
import tiny_run
from PIL import Image

from taichisoft_outputs import Recording, RecordingError, report
from taichisoft_outputs import report as report_contents
from taichisoft_outputs.metrics import MetricsOutput
from taichisoft_outputs.plots import Plots, draw_plots
from taichisoft_outputs.recording.recording_output import RecordingNeeded
from taichisoft_outputs.report import ReportError, ReportOutput, write_report


class Page(HTMLParser):
    """What a browser would make of a page: its text, the sources of its media, and its links."""

    EMPTY = ("meta", "img", "br", "use", "path", "rect")

    def __init__(self, page: str):
        super().__init__()
        self.text, self.sources, self.links = "", {}, []
        self.elements: set[str] = set()
        self._open: list[str] = []
        self.feed(page)
        assert self._open == [], "every element is closed"

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        self.elements.add(tag)
        if tag not in self.EMPTY:
            self._open.append(tag)
        if "src" in found:
            self.sources.setdefault(tag, []).append(found["src"])
        self.links += [value for name, value in attributes if name in ("href", "xlink:href")]

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attributes)
        if tag not in self.EMPTY:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self._open or self._open[-1] != "style":
            self.text += data


def draw(path: Path, colour: tuple[int, int, int] = (200, 30, 30)) -> bytes:
    Image.fromarray(np.full((20, 30, 3), colour, dtype=np.uint8)).save(path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with metrics."""
    folder = tmp_path_factory.mktemp("run")
    title = 'title="<b>pads</b> & \\"cube\\""'
    tiny_run.tiny_run(folder, [title], outputs=[MetricsOutput(folder)])
    return folder / "recording.h5"


@pytest.fixture(autouse=True, scope="module")
def plots_drawn_once() -> Iterator[None]:
    """Many tests make a page, and its plots take the most time; those of one recording do for all."""
    drawn: list[Plots] = []

    def draw_once(recording: Recording, format: str, columns_apart: bool) -> Plots:
        if not drawn:
            drawn.append(draw_plots(recording, format, columns_apart=columns_apart))
        return drawn[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report_contents, "draw_plots", draw_once)
        yield


@pytest.fixture
def folder(run: Path, tmp_path: Path) -> Path:
    """A folder of its own with that run."""
    for path in run.parent.iterdir():
        (tmp_path / path.name).symlink_to(path)
    return tmp_path


def page_of(folder: Path) -> Page:
    return Page(write_report(folder / "recording.h5").read_text(encoding="utf-8"))


def test_the_page_needs_nothing_else(folder: Path) -> None:
    """All media are in it, and no link leads out of it."""
    draw(folder / "before.png")
    (folder / "run.mp4").write_bytes(b"video")
    page = page_of(folder)
    assert page.links and all(link.startswith("#") for link in page.links)
    assert all(source.startswith("data:") for sources in page.sources.values() for source in sources)


def test_pictures_are_embedded_in_the_order_of_the_run(folder: Path) -> None:
    moments = ["before_front", "grasped", "lifted", "picture_1_at_0.20s"]
    content = {name: draw(folder / f"{name}.png", (50 * i, 0, 0)) for i, name in enumerate(reversed(moments))}
    draw(folder / "plots.png")
    page = page_of(folder)
    found = [base64.b64decode(source.split(",", 1)[1]) for source in page.sources["img"]]
    assert found == [content[name] for name in moments], "the plots are drawn anew, and not shown twice"
    assert "before front" in page.text


def test_a_video_is_embedded_unless_it_is_large(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "grasp.mp4").write_bytes(b"moving")
    assert page_of(folder).sources["video"] == ["data:video/mp4;base64," + base64.b64encode(b"moving").decode()]
    monkeypatch.setattr(report, "EMBEDDED_BYTES", 5)
    path = folder / "sub" / "page.html"
    page = Page(write_report(folder / "recording.h5", path).read_text(encoding="utf-8"))
    assert "../grasp.mp4" in page.links and "too large to be embedded" in page.text
    assert not page.sources


def test_a_name_leads_to_its_file_and_is_never_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names may come from elsewhere, and need not be text: a colon, "#", "?", "%", quotes, and bytes of no letter."""
    monkeypatch.setattr(report, "EMBEDDED_BYTES", 5)
    names = [b"javascript:alert(1).png", b"a#b?c%41.png", b'" onclick="alert(1).gif', b"<img src=x>.mp4", b"\xff.png"]
    for name in names:
        (folder / os.fsdecode(name)).write_bytes(b"picture")
    page = page_of(folder)
    assert not page.sources and "img" not in page.elements
    assert not any(urlsplit(link).scheme for link in page.links)
    assert set(names) <= {unquote_to_bytes(urlsplit(link).path) for link in page.links}


def test_plots_metrics_scene_and_versions_are_shown(folder: Path) -> None:
    page = page_of(folder)
    metrics = json.loads((folder / "metrics.json").read_text())
    for text in ("pressure [kPa]", "bending angle [degrees]", "young_modulus = 100.0", "taichi1.", "Python3."):
        assert text in page.text
    assert f"step time median [ms]{metrics['step_time_median_ms']:.4g}" in page.text
    assert "held-" in page.text, "the scene has no goal"
    assert "completed" in page.text and "0.4 s simulated" in page.text


def test_everything_is_escaped(folder: Path) -> None:
    page = write_report(folder / "recording.h5").read_text(encoding="utf-8")
    assert "<b>pads" not in page and "&lt;b&gt;pads&lt;/b&gt; &amp; &#34;cube&#34;" in page
    draw(folder / "a<script>.png")
    (folder / "metrics.json").unlink()
    (folder / "metrics.json").write_text(
        '{"outcome": "<script>alert(1)</script>", "goal": "held", "goal_reached": false}'
    )
    page = write_report(folder / "recording.h5").read_text(encoding="utf-8")
    assert "<script" not in page and "not held" in page


def test_a_grasp_that_is_doubtful_is_not_shown_as_good(folder: Path) -> None:
    (folder / "metrics.json").unlink()
    figures = {"outcome": "completed", "goal": "held", "goal_reached": True, "goal_is_doubtful": True}
    figures |= {"unconverged_steps": 7, "steps": 20}
    (folder / "metrics.json").write_text(json.dumps(figures))
    page = write_report(folder / "recording.h5").read_text(encoding="utf-8")
    assert '<span class="pill bad">held, doubtful: 7 of 20 steps did not converge</span>' in page


def test_a_run_that_its_user_ended_is_shown_as_not_judged(folder: Path) -> None:
    (folder / "metrics.json").unlink()
    (folder / "metrics.json").write_text(json.dumps({"outcome": "stopped", "goal": "held", "goal_reached": None}))
    page = write_report(folder / "recording.h5").read_text(encoding="utf-8")
    assert '<span class="pill bad">held: not judged</span>' in page


def test_what_is_missing_is_said(run: Path, tmp_path: Path) -> None:
    (tmp_path / "recording.h5").symlink_to(run)
    page = page_of(tmp_path)
    assert "There are no pictures: taichisoft render" in page.text
    assert "There are no metrics: the run was made without the output 'metrics'." in page.text
    (tmp_path / "metrics.json").write_text('{"outcome": ')
    assert "There are no metrics: " in page_of(tmp_path).text and "is not readable" in page_of(tmp_path).text


def test_the_output_marks_pictures_of_an_earlier_run(tmp_path: Path) -> None:
    """It knows when its own run began."""
    draw(tmp_path / "before.png")
    old = time.time() - 100.0
    os.utime(tmp_path / "before.png", (old, old))
    report = ReportOutput(tmp_path)
    tiny_run.tiny_run(tmp_path, outputs=[report])
    assert "older than this run; it may show another one" in (tmp_path / "report.html").read_text()
    draw(tmp_path / "before.png")
    report.end("completed")
    assert "older than this run" not in (tmp_path / "report.html").read_text()


def test_without_a_recording_the_run_does_not_begin_and_no_page_is_made_of_an_older_one(folder: Path) -> None:
    report = ReportOutput(folder)
    with pytest.raises(RecordingNeeded, match="output 'report' needs the output 'recording' before it"):
        report.begin(fake_run.fake_model(), fake_run.fake_state(0))
    report.end("output 'report' needs the output 'recording' before it")
    assert not (folder / "report.html").exists()


def test_nobody_waits_after_an_interruption_but_a_failed_run_gets_its_page(tmp_path: Path) -> None:
    report = ReportOutput(tmp_path)
    tiny_run.tiny_run(tmp_path, outputs=[report])
    (tmp_path / "report.html").unlink()
    report.end("interrupted")
    assert not (tmp_path / "report.html").exists()
    report.end("step 7: body 'left' exploded")
    assert (tmp_path / "report.html").exists()


def test_a_run_that_was_started_anew_says_so(tmp_path: Path) -> None:
    tiny_run.tiny_run(tmp_path, restart_after=10)
    assert "restarted once; the report shows what came after the last start" in page_of(tmp_path).text


def test_the_command_says_where_the_page_is(folder: Path, tmp_path: Path) -> None:
    shown = tiny_run.command("recording", "report", folder / "recording.h5", "-o", tmp_path / "pages" / "one.html")
    assert shown.output.split() == [str(tmp_path / "pages" / "one.html")]
    assert (tmp_path / "pages" / "one.html").is_file()


def test_errors_name_the_file(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"nothing\.h5: no such recording"):
        write_report(tmp_path / "nothing.h5")
    (tmp_path / "file").write_text("")
    with pytest.raises(ReportError, match=r"file/report\.html: not written: "):
        write_report(folder / "recording.h5", tmp_path / "file" / "report.html")


def test_what_is_smaller_than_the_accuracy_is_nothing(folder: Path) -> None:
    """The solver's noise of 5e-13 mm is no slip."""
    (folder / "metrics.json").unlink()
    (folder / "metrics.json").write_text('{"object_slip_mm": -4.97e-13, "object_lift_mm": 29.5}')
    page = write_report(folder / "recording.h5").read_text(encoding="utf-8")
    assert "<b>0</b> mm" in page and "<b>29.5</b> mm" in page
    assert "e-13" not in page


def test_quantities_have_the_units_of_the_plots_and_points_their_brackets() -> None:
    metrics = {
        "final_volumes_mm3": {"a.cavity": 13350.0},
        "final_contact_areas_mm2": {"a|cube": 61.0},
        "final_tip_positions_mm": {"a": [1.5, -2.0, 1e-9]},
        "steps": 3,
    }
    assert list(report._rows(metrics)) == [
        ("final volumes [cm³]", "a.cavity: 13.35"),
        ("final contact areas [mm²]", "a|cube: 61"),
        ("final tip positions [mm]", "a: (1.5, -2, 0)"),
        ("steps", "3"),
    ]
