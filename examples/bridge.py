"""Put another program in the loop: observations out and commands in as JSON by UDP, paced to real time.

An observation goes out before every step, and the answer to it is what the step is driven with; without an answer in
time, what was asked for last stays. `python examples/bridge.py HOST:PORT` talks to a program of yours, such as the ROS
2 node of docs/ros2.md or the driver of a valve terminal. Without an address a thread of this program answers: it
raises the pressure by 0.5 kPa in every step until the finger bends by 10 degrees, and then holds it; the finger swings
on. How long answers took goes to standard error, and what was wrong with those that are not followed.

Only packets from the address that the observations go to are read, so answer from the socket that received them. UDP
itself proves no address: keep both ends on one machine, or in a network of their own.

Prints:

    100 observations went out, 100 commands came in
    1.00 s: 18.50 kPa, bent by 13.52 degrees
"""

import contextlib
import json
import math
import socket
import sys
import threading
import time

import taichisoft
from taichisoft.errors import TaichisoftError


def answer(peer: socket.socket) -> None:
    """The other side: a program in any language that reads and writes such messages."""
    pressure = 0.0
    while True:
        message, sender = peer.recvfrom(65536)
        seen = json.loads(message)
        pressure += 0.5 if seen["bending"]["finger"] < 10.0 else 0.0
        peer.sendto(json.dumps({"time": seen["time"], "pressure": {"finger.cavity": pressure}}).encode(), sender)


def exchange(message: dict[str, object]) -> dict[str, float]:
    """Send a message, and return the pressures of the answer, none where none comes within `patience` [s]."""
    sent = time.monotonic()
    with contextlib.suppress(ConnectionError):  # nobody was there for the message before
        link.send(json.dumps(message).encode())
    while (left := sent + patience - time.monotonic()) > 0.0:
        link.settimeout(left)
        try:
            command = json.loads(link.recv(65536))
            if command["time"] == message["time"]:  # else it is an answer that came too late
                latencies.append(1e3 * (time.monotonic() - sent))
                return dict(command.get("pressure", {}))
        except OSError:  # time is up, or nobody is there yet
            continue
        except (LookupError, RecursionError, TypeError, ValueError) as error:
            print(f"not an answer: {type(error).__name__}: {error}", file=sys.stderr)
    return {}


own, link = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
if ":" in sys.argv[-1]:
    host, port = sys.argv[1].rsplit(":", 1)
    address, patience = (host, int(port)), 0.005
else:
    own.bind(("127.0.0.1", 0))
    threading.Thread(target=answer, args=(own,), daemon=True).start()
    address, patience = own.getsockname(), 60.0  # it is waited for, so that every run is the same
link.connect(address)  # from now on the system drops packets from elsewhere

simulation = taichisoft.Simulation(taichisoft.load_scene("finger-inflated"))
seen, latencies, begun = simulation.observe(), list[float](), time.monotonic()
for _ in range(100):
    bending = {name: math.degrees(angle) for name, angle in seen.bending_angles.items()}
    pressure = exchange({"time": seen.time, "pressures": dict(seen.pressures), "bending": bending})
    try:
        seen = simulation.step(taichisoft.Control(pressure=pressure)).observation
    except TaichisoftError as error:
        print(f"not followed: {error}", file=sys.stderr)
        seen = simulation.step().observation
    time.sleep(max(0.0, begun + seen.time - time.monotonic()))  # real time; a slow machine falls behind

angle, reached = math.degrees(seen.bending_angles["finger"]), seen.pressures["finger.cavity"]
print(f"100 observations went out, {len(latencies)} commands came in")
print(f"{seen.time:.2f} s: {reached:.2f} kPa, bent by {angle:.2f} degrees")
if latencies:
    median, longest = sorted(latencies)[len(latencies) // 2], max(latencies)
    print(f"latency: {median:.2f} ms in the middle, {longest:.2f} ms at most", file=sys.stderr)
