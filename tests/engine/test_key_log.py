"""A key log gives back the keys that were written, each at its step."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichisoft import KeyEvent
from taichisoft.control.control import KeyStream
from taichisoft.running.session import KeyLog, KeyLogError, KeyReplay

# Some library that Taichi loads lets this process round subnormal numbers to 0.
values = st.none() | st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
places = st.none() | st.just(()) | st.tuples(*3 * [values.filter(lambda value: value is not None)])
events = st.builds(KeyEvent, st.text(min_size=1, max_size=8), st.booleans(), values, places)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(pressed=st.lists(st.tuples(st.integers(0, 5), events), max_size=20))
def test_keys_come_back_at_their_steps(tmp_path: Path, pressed: list[tuple[int, KeyEvent]]) -> None:
    log, step, written = KeyLog(tmp_path / "keys.jsonl"), 0, []
    for later, event in pressed:
        step += later
        log.add(step, event)
        written.append((step, event))
    log.end(step + 3)
    replay = KeyReplay(tmp_path / "keys.jsonl")
    assert replay.step_count == step + 3
    assert [(k, event) for k in range(step + 1) for event in replay.take(k)] == written


def test_killed_session_leaves_its_keys(tmp_path: Path) -> None:
    log = KeyLog(tmp_path / "keys.jsonl")
    log.add(7, KeyEvent("+", ctrl=True))
    replay = KeyReplay(tmp_path / "keys.jsonl")  # the log was never ended
    assert replay.step_count == 7
    assert replay.take(7) == [KeyEvent("+", ctrl=True)]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("plus", "line 2: not readable as JSON: "),
        ("[1]", 'line 2: [1]: must look like {"step": 12, "key": "+"}'),
        ('{"step": -1, "key": "a"}', 'must look like {"step": 12, '),
        ('{"step": 1.5, "key": "a"}', 'must look like {"step": 12, '),
        ('{"step": 4, "key": 5}', 'must look like {"step": 12, '),
        ('{"step": 4, "key": "a", "ctrl": "yes"}', 'must look like {"step": 12, '),
        ('{"step": 4, "key": "a", "value": NaN}', "line 2: value = nan: must be a finite number"),
        ('{"step": 4, "key": "a", "value": true}', "line 2: value = True: must be a finite number"),
        ('{"step": 4, "key": "a", "pointer": [1, 2]}', "line 2: pointer = [1, 2]: must be 3 finite numbers, or []"),
        ('{"step": 4, "key": "a", "pointer": [1, 2, NaN]}', "line 2: pointer = [1, 2, nan]: must be 3 finite numbers"),
        ('{"step": 4, "key": "a", "pointer": "up"}', "line 2: pointer = 'up': must be 3 finite numbers"),
        ('{"step": 2, "key": "a"}', "line 2: step = 2: must not be below 3"),
    ],
)
def test_damaged_log_is_refused(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "keys.jsonl"
    path.write_text('{"step": 3, "key": "a"}\n' + line + "\n")
    with pytest.raises(KeyLogError) as refused:
        KeyReplay(path)
    assert str(refused.value).startswith(str(path)) and message in str(refused.value)


def test_missing_log_and_unwritable_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(KeyLogError, match=r"none\.jsonl: not readable as a key log: "):
        KeyReplay(tmp_path / "none.jsonl")
    (tmp_path / "file").write_text("")
    with pytest.raises(KeyLogError, match=r"file/keys\.jsonl: cannot be written: "):
        KeyLog(tmp_path / "file" / "keys.jsonl")


def test_stream_gives_each_key_once_and_in_order() -> None:
    stream = KeyStream()
    for key in "abc":
        stream.put(KeyEvent(key))
    stream.wait(60.0)  # returns at once: there is a key
    assert [event.key for event in stream.take()] == ["a", "b", "c"]
    assert stream.take() == []


def test_keys_are_written_as_people_write_them() -> None:
    assert [str(KeyEvent("up")), str(KeyEvent("+", ctrl=True))] == ["up", "Ctrl++"]
    assert str(KeyEvent("left.air", value=12.5)) == "left.air=12.5"
    assert str(KeyEvent("cube", pointer=(1.0, 2.5, 3.0))) == "cube at 1, 2.5, 3"
