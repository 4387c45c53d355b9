"""Scripts from files: keyframes in TOML and CSV, what they ask for, and their refusals."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import CAVITIES, controller_of, follow, made_up_model, pressures, refusal, write

from taichisoft import Control, Controller, Observation, Simulation, load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_controllers.script_file import read_keyframes
from taichisoft_controllers.scripted_controller import scripted_controller

SCRIPT = """
interpolation = "{interpolation}"
[[keyframes]]
time = 0.5
pressure = 0.0
[[keyframes]]
time = 1.5
pressure = 40.0
base_translation = [3.0, 6.0, -9.0]
base_rotation = [90.0, 0.0, 0.0]
[[keyframes]]
time = 3.5
pressure = 10.0
"""


def script(folder: Path, interpolation: str = "linear", content: str = SCRIPT) -> Path:
    return write(folder, content.replace("{interpolation}", interpolation))


def ask(controller: Controller, time: float) -> Control:
    controller.reset(made_up_model())
    return controller.control(Observation(time, 0))


def pressure(controller: Controller, time: float) -> float:
    pressures = ask(controller, time).pressure
    (value,) = {pressures[name] for name in CAVITIES}
    assert len(pressures) == len(CAVITIES)
    return value


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_keyframes_are_hit_exactly(tmp_path: Path, interpolation: str) -> None:
    controller = scripted_controller(script(tmp_path, interpolation))
    assert [pressure(controller, time) for time in (0.5, 1.5, 3.5)] == [0.0, 40.0, 10.0]
    control = ask(controller, 1.5)
    assert control.base_translation is not None and control.base_rotation is not None
    assert control.base_translation.tolist() == [3.0, 6.0, -9.0]
    assert control.base_rotation.tolist() == [np.pi / 2, 0.0, 0.0]  # degrees in the file, radians to the engine


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_before_the_first_and_after_the_last_keyframe_it_holds(tmp_path: Path, interpolation: str) -> None:
    controller = scripted_controller(script(tmp_path, interpolation))
    assert [pressure(controller, time) for time in (0.0, 0.49, 3.51, 1e6)] == [0.0, 0.0, 10.0, 10.0]


def test_linear_means_in_proportion_to_time(tmp_path: Path) -> None:
    controller = scripted_controller(script(tmp_path, "linear"))
    assert pressure(controller, 0.75) == pytest.approx(10.0, rel=1e-12)
    assert pressure(controller, 3.0) == pytest.approx(17.5, rel=1e-12)
    translation = ask(controller, 1.0).base_translation
    np.testing.assert_allclose(translation, [1.5, 3.0, -4.5], rtol=1e-12)


def test_smooth_follows_its_cubic(tmp_path: Path) -> None:
    """A share s of the way in time is 3 s^2 - 2 s^3 of the way in value."""
    controller = scripted_controller(script(tmp_path, "smooth"))
    for share in (0.1, 0.25, 0.5, 0.9):
        assert pressure(controller, 0.5 + share) == pytest.approx(40.0 * (3 * share**2 - 2 * share**3), rel=1e-12)


def test_smooth_starts_and_ends_at_rest_and_linear_does_not(tmp_path: Path) -> None:
    """One-sided slopes at a keyframe: of order dt for the cubic (3 dt / T^2 times the range), 40 kPa/s for the line."""
    dt = 1e-6
    for interpolation, largest, least in (("smooth", 40.0 * 3 * dt * 1.01, 0.0), ("linear", 40.1, 14.9)):
        controller = scripted_controller(script(tmp_path, interpolation))
        for time in (0.5 + dt, 1.5 - dt, 1.5 + dt, 3.5 - dt):
            nearest_keyframe = min((0.5, 1.5, 3.5), key=lambda keyframe: abs(keyframe - time))
            slope = abs(pressure(controller, time) - pressure(controller, nearest_keyframe)) / dt
            assert least <= slope <= largest


def test_a_pressure_scales_the_script_to_its_largest(tmp_path: Path) -> None:
    controller = scripted_controller(script(tmp_path), pressure=80.0)
    assert [pressure(controller, time) for time in (0.5, 1.5, 3.5)] == pytest.approx([0.0, 80.0, 20.0])
    translation = ask(controller, 1.5).base_translation
    assert translation is not None and translation.tolist() == [3.0, 6.0, -9.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "[[keyframes]]\ntime=1\npressure=1\n[[keyframes]]\ntime=0.5\npressure=1",
            "must increase; they are [1.0, 0.5]",
        ),
        ("[[keyframes]]\ntime=1\npressure=1\n[[keyframes]]\ntime=1\npressure=1", "must increase; they are [1.0, 1.0]"),
        ("[[keyframes]]\ntime=1\npresure=1", "keyframes.0.presure: unknown key; did you mean 'pressure'?"),
        ("interpolatin='linear'\nkeyframes=[{time=1,pressure=1}]", "unknown key; did you mean 'interpolation'?"),
        ("interpolation='cubic'\nkeyframes=[{time=1,pressure=1}]", "interpolation = 'cubic': input should be 'linear'"),
        ("keyframes=[{time=-1,pressure=1}]", "keyframes.0.time = -1: input should be greater than or equal to 0"),
        ("keyframes=[{time=1,pressure=nan}]", "keyframes.0.pressure = nan: input should be a finite number"),
        ("keyframes=[{time=1,pressure='1'}]", "keyframes.0.pressure = '1': input should be a valid number"),
        ("keyframes=[{time=1,pressure=1,base_translation=[1,2]}]", "= [1, 2]: has 2 values; 3 are needed"),
        ("keyframes=[]", "keyframes = []: at least 1 is needed"),
        ("", "exactly one of keyframes, steps is needed; given: none"),
        ("keyframes=[", "not readable as TOML: "),
    ],
)
def test_a_wrong_script_is_refused_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    assert message in refusal(script(tmp_path, content=content))


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, "high", True])
def test_a_wrong_pressure_is_named_as_a_setting(tmp_path: Path, value: Any) -> None:
    with pytest.raises(SceneError, match=r"^controller\.settings\.pressure = "):
        scripted_controller(script(tmp_path), pressure=value)


def test_suction_turns_keyframes_but_not_steps_with_rates(tmp_path: Path) -> None:
    turned = scripted_controller(script(tmp_path), pressure=-20.0)
    assert [pressure(turned, time) for time in (0.5, 1.5, 3.5)] == [0.0, -20.0, -5.0]
    with pytest.raises(SceneError, match=r"^controller\.settings\.pressure = -20: .* has steps with rates"):
        scripted_controller("grasp-until-contact", pressure=-20.0)


def test_a_script_without_pressure_cannot_be_scaled() -> None:
    with pytest.raises(SceneError, match=r"rest\.toml: has no pressure above 0"):
        scripted_controller("rest", pressure=50.0)


# Scripts as comma-separated values: the same as their TOML, and what is refused, with line and column.

CSV = """\
# two fingers close, one after the other
time [s], pressure left [kPa], pressure right [kPa], base_translation z [mm], base_rotation x [degrees]
0.2,      0,                   0,                    0,                       0

1.2,      50,                  0,                    0,                       0
1.7,      50,                  4e1,                  30.5,                    90
"""
TOML = """
[[keyframes]]
time = 0.2
pressure = { left = 0.0, right = 0.0 }
[[keyframes]]
time = 1.2
pressure = { left = 50.0, right = 0.0 }
[[keyframes]]
time = 1.7
pressure = { left = 50.0, right = 40.0 }
base_translation = [0.0, 0.0, 30.5]
base_rotation = [90.0, 0.0, 0.0]
"""


@pytest.mark.parametrize("interpolation", [None, "smooth"])
def test_a_csv_asks_for_the_same_as_its_toml(tmp_path: Path, interpolation: str | None) -> None:
    one = follow(controller_of(tmp_path, CSV, "script.csv", interpolation=interpolation), 2.0)
    other = follow(controller_of(tmp_path, TOML, interpolation=interpolation), 2.0)
    assert one.keys() == other.keys()
    for time, control in one.items():
        assert control.pressure == other[time].pressure
        np.testing.assert_array_equal(control.base_translation, other[time].base_translation)
        np.testing.assert_array_equal(control.base_rotation, other[time].base_rotation)


@pytest.mark.parametrize(
    "content",
    [
        "time,pressure\n0,7\n",
        "\ufefftime,pressure\r\n0,7\r\n",
        'pressure [kPa],"time [s]"\n"7",0',
        "time ,pressure[kPa]\n 0 , 7 ",
    ],
)
def test_what_programs_and_people_write_is_read(tmp_path: Path, content: str) -> None:
    """With a byte-order mark and line ends as from Excel, columns in any order, quotes, blanks."""
    assert pressures(follow(controller_of(tmp_path, content, "script.csv"), 0.0)[0.0]) == [7.0] * 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "needs a first line with the names of the columns, as in: time,pressure"),
        ("# only a comment", "needs a first line"),
        ("time,pressure", "keyframes = []: at least 1 is needed"),
        ("tme,pressure\n0,1", "column 'tme': unknown; did you mean 'time'?"),
        ("time,pressure,base_x\n0,1,1", "column 'base_x': unknown; "),
        ("time;pressure\n0;1", "column 'time;pressure': unknown; "),
        ("time,pressure [bar]\n0,1", "column 'pressure [bar]': its unit is kPa, not bar"),
        ("time [ms],pressure\n0,1", "column 'time [ms]': its unit is s, not ms"),
        ("# a\ntime,time,pressure\n0,1,1", "there are 2 columns 'time'; keep one"),
        ("time,pressure,pressure left\n0,1,1", "the columns 'pressure' and 'pressure left' exclude each other"),
        ("pressure\n1", "the column 'time' is missing; columns are: pressure"),
        ("time\n1", "keyframes.0: needs at least one of pressure, valve, pull, tension"),
        ("time,pressure\n\n0", "0: has 1 cells; 2 are needed, one for each column"),
        ("time,pressure\n0,1,2", "0,1,2: has 3 cells; 2 are needed"),
        ("time,pressure\n0,", "0,: each cell must be a number, as in 0.5"),
        ("time,pressure\n0,high", "0,high: each cell must be a number, as in 0.5"),
        ("time,pressure\n0,nan", "keyframes.0.pressure = nan: input should be a finite number"),
        ("time,pressure\n1,1\n0.5,1", "the times of the keyframes must increase; they are [1.0, 0.5]"),
        ("time,pressure\n-1,1", "keyframes.0.time = -1.0: input should be greater than or equal to 0"),
        ("time,pressure\n0,\0", "each cell must be a number"),
    ],
)
def test_a_wrong_csv_is_refused_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    assert message in refusal(write(tmp_path, content, "script.csv"))


def test_a_finger_that_there_is_not_is_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"keyframes\.0\.pressure: no finger or cavity is called 'lift'; did you mean"):
        controller_of(tmp_path, "time,pressure lift,pressure right\n0,1,1", "script.csv")


def test_a_file_that_is_no_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "script.csv"
    path.write_bytes(b"time,pressure\n\xff\xfe")
    with pytest.raises(SceneError, match=r"script\.csv: not readable as CSV: "):
        scripted_controller(path)


@given(st.text() | st.text("time,prsu \n0123456789.\"'[]#kPa", max_size=60).map("time,pressure\n".__add__))
def test_whatever_is_in_it_only_a_scene_error_comes_out(text: str) -> None:
    try:
        tables = read_keyframes(text)
    except SceneError:
        return
    assert set(tables) == {"keyframes"}


# Files of scripts: pressures by finger, and what is refused, with file, key, value and what would be valid.


def keyframe(pressure: str) -> str:
    return f"keyframes = [{{ time = 0.0, pressure = {pressure} }}]"


@pytest.mark.parametrize(
    ("pressure", "expected"),
    [
        ("7", [7.0, 7.0, 7.0]),
        ("{ left = 1.0, right = 2.0 }", [1.0, 1.0, 2.0]),
        ('{ right = 2, "left.tip" = 3, "left.base" = 1 }', [1.0, 3.0, 2.0]),
        ("{ right.base = 2.0, left.tip = 3.0, left.base = 1.0 }", [1.0, 3.0, 2.0]),  # tables in tables, to TOML
    ],
)
def test_pressure_is_for_all_or_by_finger_or_cavity(tmp_path: Path, pressure: str, expected: list[float]) -> None:
    assert pressures(follow(controller_of(tmp_path, keyframe(pressure)), 0.0)[0.0]) == expected


def test_each_cavity_is_interpolated_between_its_own_keyframes(tmp_path: Path) -> None:
    script = (
        "[[keyframes]]\ntime = 0\npressure = { left = 0.0, right = 30.0 }\n[[keyframes]]\ntime = 1\npressure = 10.0"
    )
    asked = follow(controller_of(tmp_path, script), 0.5)
    assert pressures(asked[0.5]) == pytest.approx([5.0, 5.0, 20.0])


def test_the_largest_of_all_cavities_is_scaled(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, keyframe("{ left = 10.0, right = 40.0 }"), pressure=80.0)
    assert pressures(follow(controller, 0.0)[0.0]) == [20.0, 20.0, 80.0]


def test_a_setting_replaces_the_interpolation(tmp_path: Path) -> None:
    script = "keyframes = [{ time = 0.0, pressure = 0.0 }, { time = 1.0, pressure = 8.0 }]"
    linear = follow(controller_of(tmp_path, script), 0.25)[0.25]
    smooth = follow(controller_of(tmp_path, script, interpolation="smooth"), 0.25)[0.25]
    assert (pressures(linear)[0], pressures(smooth)[0]) == pytest.approx((2.0, 1.25))


@pytest.mark.parametrize("value", ["cubic", 3, ""])
def test_a_wrong_interpolation_is_named_as_a_setting(tmp_path: Path, value: str) -> None:
    with pytest.raises(SceneError, match=r"^controller\.settings\.interpolation = .*: input should be 'linear' or"):
        scripted_controller(write(tmp_path, keyframe("1.0")), interpolation=value)


@pytest.mark.parametrize(
    ("pressure", "message"),
    [
        ("{}", "keyframes.0.pressure: names no finger or cavity"),
        ("{ left = '1' }", "keyframes.0.pressure: left = '1' must be a finite number [kPa]"),
        ("{ left = inf }", "keyframes.0.pressure: left = inf must be a finite number [kPa]"),
        ("{ left = { tip = true } }", "keyframes.0.pressure: left.tip = True must be a finite number [kPa]"),
        ("[1.0]", "keyframes.0.pressure = [1.0]: input should be a valid number"),
        ("true", "keyframes.0.pressure = True: input should be a valid number"),
    ],
)
def test_a_wrong_pressure_is_refused_when_the_file_is_read(tmp_path: Path, pressure: str, message: str) -> None:
    assert refusal(write(tmp_path, keyframe(pressure))) == message


STEP = "[[steps]]\npressure = {}\nduration = 1.0"


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            keyframe("{ lift = 1.0 }"),
            "keyframes.0.pressure: no finger or cavity is called 'lift'; did you mean 'left'?",
        ),
        (keyframe("{ left.tap = 1.0 }"), "no finger or cavity is called 'left.tap'; did you mean 'left.tip'?"),
        (
            keyframe("{ left = 1.0 }"),
            "keyframes.0.pressure: does not name 'right.base'; a keyframe has the pressure of",
        ),
        (keyframe("{ left = 1.0, right = 1.0, 'left.tip' = 2.0 }"), "'left.tip' is given twice, the second time as"),
        (STEP.format("{ lift = 1.0 }"), "steps.0.pressure: no finger or cavity is called 'lift'; did you mean 'left'?"),
        (
            "[[steps]]\nname = 'wait'\nuntil = 'contact_force[\"left|cub\"] > 1'\ntimeout = 1.0",
            "steps.0 'wait': until = 'contact_force[\"left|cub\"] > 1': contact_force[\"left|cub\"]: "
            "no pair of bodies is called 'left|cub'; did you mean 'left|cube'?",
        ),
    ],
)
def test_unknown_name_is_refused_before_the_run(tmp_path: Path, script: str, message: str) -> None:
    assert message in refusal(tmp_path / "script.toml", lambda _: controller_of(tmp_path, script))


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            "steps = [{ hold = 1.0 }]\nkeyframes = [{ time = 0.0, pressure = 1.0 }]",
            "exactly one of keyframes, steps is needed; given: keyframes, steps",
        ),
        ("step = [{ hold = 1.0 }]", "step: unknown key; did you mean 'steps'?"),
        ("steps = []", "steps = []: at least 1 is needed"),
        ("steps = [{}]", "steps.0: does nothing; it needs at least one of pressure, valve, pull, tension,"),
        ("steps = [{ name = 'a' }]", "steps.0: does nothing"),
        ("steps = [{ time = 1.0, pressure = 1.0 }]", "steps.0.time: unknown key; "),
        ("keyframes = [{ time = 1.0, pressure = 1.0, until = 'time > 1' }]", "keyframes.0.until: unknown key; "),
        ("steps = [{ untill = 'time > 1', timeout = 1.0 }]", "steps.0.untill: unknown key; did you mean 'until'?"),
        ("steps = [{ until = 'time > 1' }]", "steps.0: until needs a timeout [s], after which the run fails"),
        ("steps = [{ hold = 1.0, timeout = 1.0 }]", "steps.0: timeout without until has no effect"),
        ("steps = [{ until = 'time > 1', timeout = 0.0 }]", "steps.0.timeout = 0.0: input should be greater than 0"),
        ("steps = [{ until = true, timeout = 1.0 }]", "steps.0.until = True: input should be a valid string"),
        ("steps = [{ pressure = 1.0 }]", "steps.0: pressure needs a duration [s] or a pressure_rate [kPa/s]"),
        (
            "steps = [{ base_translation = [1.0, 0.0, 0.0], pressure = 1.0, pressure_rate = 1.0 }]",
            "steps.0: base_translation needs a duration [s] or a base_speed [mm/s]",
        ),
        ("steps = [{ base_rotation = [1.0, 0.0, 0.0] }]", "or a base_turning_speed [degrees/s]"),
        (
            "steps = [{ pressure = 1.0, pressure_rate = 1.0, duration = 1.0 }]",
            "steps.0: duration and pressure_rate are both given; give one of them",
        ),
        ("steps = [{ hold = 1.0, base_speed = 1.0 }]", "steps.0: base_speed without base_translation has no effect"),
        ("steps = [{ duration = 1.0 }]", "steps.0: duration without anything that moves; to wait, give hold [s]"),
        ("steps = [{ hold = -1.0 }]", "steps.0.hold = -1.0: input should be greater than 0"),
        ("steps = [{ pressure = nan, duration = 1.0 }]", "steps.0.pressure = nan: input should be a finite number"),
        (
            "steps = [{ hold = 1.0 }, { name = 'close', until = 'contact_forse > 60', timeout = 1.0 }]",
            "steps.1 'close': until = 'contact_forse > 60': no quantity is called 'contact_forse'; "
            "did you mean 'contact_force'?",
        ),
        (
            "steps = [{ until = 'contact_force', timeout = 1.0 }]",
            "steps.0: until = 'contact_force': 'contact_force' is a number; compare it with something",
        ),
    ],
)
def test_a_wrong_file_of_steps_is_refused_in_one_line(tmp_path: Path, script: str, message: str) -> None:
    assert message in refusal(write(tmp_path, script))


def test_steps_without_pressure_cannot_be_scaled(tmp_path: Path) -> None:
    path = write(tmp_path, "steps = [{ hold = 1.0 }]")
    with pytest.raises(SceneError, match="has no pressure above 0"):
        scripted_controller(path, pressure=50.0)


# Forces from outside.

FREE = ("gravity=[0,0,0]", "rigid_bodies.cube.position=[0,0,60]")
"""Nothing touches or moves the cube of the tiny gripper, of 1 g."""
PUSHES = """
keyframes = [
    {time = 0.0, pressure = 0.0},
    {time = 0.1, pressure = 0.0, forces.cube = {force = [2.0, 0.0, 0.0], torque = [0.0, 0.0, 1.0]}},
    {time = 0.2, pressure = 0.0, forces = {cube.force = [2.0, 0.0, 0.0], left = {force = [0.0, 1.0, 0.0], POINT}}},
    {time = 0.3, pressure = 0.0},
]
""".replace("POINT", "point = [-9.0, 6.0, 16.0], axes = 'own'")


def test_forces_of_keyframes_are_interpolated(tmp_path: Path) -> None:
    """F t of a trapezium, with the force at the start of each step; a torque and a soft body's push between two."""
    simulation = Simulation(load_scene(TINY_GRIPPER, FREE))
    controller = scripted_controller(write(tmp_path, PUSHES))
    controller.reset(simulation.model)
    seen = []
    for _ in range(35):
        simulation.step(controller.control(simulation.observe()))
        seen.append(simulation.observe().external_forces)
    along = np.interp(0.01 * np.arange(35), [0.0, 0.1, 0.2, 0.3], [0.0, 2.0, 2.0, 0.0])
    np.testing.assert_allclose([forces["cube"][0] for forces in seen], along, atol=1e-9)
    assert simulation.state.rigid_velocity[0, 0] == pytest.approx(0.01 * along.sum() / 0.001)
    assert simulation.state.rigid_angular_velocity[0, 2] > 0.1
    assert [forces["left"].any() for forces in seen] == [10 < number < 30 for number in range(35)]


def test_keyframes_need_no_actuators_to_push(falling_cube: Path, tmp_path: Path) -> None:
    """A force that fades in 0.1 s; where there are cavities, keyframes still name them."""
    fading = "keyframes = [{time=0.0, forces.cube.force=[2.0, 0.0, 0.0]}, {time=0.1, forces={cube={}}}]"
    simulation, controller = Simulation(load_scene(falling_cube)), scripted_controller(write(tmp_path, fading))
    controller.reset(simulation.model)
    for _ in range(12):
        simulation.step(controller.control(simulation.observe()))
    assert simulation.state.rigid_velocity[0, 0] == pytest.approx(0.01 * 2.0 * 5.5 / 0.001)
    message = refusal(write(tmp_path, fading), lambda file: scripted_controller(file).reset(made_up_model()))
    assert message.startswith("keyframes.0.pressure: does not name ")


def test_forces_of_a_step_end_with_it(tmp_path: Path) -> None:
    simulation = Simulation(load_scene(TINY_GRIPPER, FREE))
    steps = "steps = [{hold=0.05}, {hold=0.1, forces.cube.force=[3.0, 0.0, 0.0]}, {hold=0.05}]"
    controller = scripted_controller(write(tmp_path, steps))
    controller.reset(simulation.model)
    speeds = []
    for _ in range(25):
        simulation.step(controller.control(simulation.observe()))
        speeds.append(simulation.state.rigid_velocity[0, 0])
    np.testing.assert_allclose(speeds, 30.0 * np.clip(np.arange(1, 26) - 5, 0, 10), rtol=1e-9)


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        ("forces.cub.force=[1,0,0]", "0.forces: no body or frame is called 'cub'; did you mean 'cube'?"),
        ("forces.cube=[1,0,0]", "0.forces.cube = [1, 0, 0]: "),
        ("forces.cube.forse=[1,0,0]", "0.forces.cube.forse: unknown key; did you mean 'force'?"),
        ("forces.cube.force=[1,0]", "0.forces.cube.force = [1, 0]: has 2 values; 3 are needed"),
        ("forces.cube.force=[1,nan,0]", "0.forces.cube.force.1 = nan: input should be a finite number"),
        ("forces.cube.axes='body'", "0.forces.cube.axes = 'body': input should be 'world' or 'own'"),
        ("forces.left.force=[1,0,0]", "0.forces.left.point: a soft body needs one, a place at rest [mm] such as ["),
        ("forces.left.point=[0,0,99]", "0.forces.left.point = [0.0, 0.0, 99.0]: lies "),
    ],
)
@pytest.mark.parametrize("entry", ["keyframes = [{{time=0.0, pressure=0.0, {}}}]", "steps = [{{hold=1.0, {}}}]"])
def test_forces_that_cannot_act_are_refused(tmp_path: Path, entry: str, forces: str, message: str) -> None:
    path, model = write(tmp_path, entry.format(forces)), Simulation(load_scene(TINY_GRIPPER)).model
    assert refusal(path, lambda file: scripted_controller(file).reset(model)).partition(".")[2].startswith(message)


def test_point_of_a_force_stays_in_keyframes(tmp_path: Path) -> None:
    later = PUSHES.replace("{force = [2.0, 0.0, 0.0], torque", "{point = [0, 0, 1], force = [2.0, 0.0, 0.0], torque")
    path, model = write(tmp_path, later), Simulation(load_scene(TINY_GRIPPER)).model
    message = refusal(path, lambda file: scripted_controller(file).reset(model))
    assert message == "keyframes.2.forces.cube: point and axes must be those of the keyframe that has it first"
