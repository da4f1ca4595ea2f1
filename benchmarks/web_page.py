"""Cost of the page: processor load, delay of the control loop, and time from STOP to the first neutral override.

``python3 -m benchmarks.web_page [--seconds 20] [--stops 20] [--viewers 4] [--browser]``. Goals: under 3 % of a core at
10 Hz with four viewers, ticks at most 5 ms later, STOP within 50 ms (worst of 200), page below 300 kB, and constant
memory over the ticks of an hour. With ``--browser`` the page is also open in Chromium. Its memory is printed, and the
time to STOP starts at a click on it. With ``--phone`` only this is measured: the page is opened during a run on a phone
(390 by 844 pixels, processor slowed to a quarter) until STOP can be pressed without scrolling (goal 2 s).

The server is that of ``gcs-autotune serve``. It starts this file again as a run. This sends ticks at 25 Hz to the real
``RemoteObserver``. For STOP it flies the simulator over a real link with the real sequencer.
"""

from __future__ import annotations

import argparse
import asyncio
import http.client
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.results import Figure, headline

TICK = 0.04
HOUR = 90_000
"""Ticks of an hour at 25 Hz."""
PHONE, SLOWER = {"width": 390, "height": 844}, 4
"""Screen of a phone [CSS px], and how many times slower than here its processor is."""
CLICKED = "() => addEventListener('click', (event) => { window.clicked = performance.timeOrigin + event.timeStamp })"
STOP_SEEN = """() => {
  const stop = document.getElementById("stop");
  if (!stop || stop.disabled) return 0;
  const box = stop.getBoundingClientRect();
  const within = box.top >= 0 && box.bottom <= innerHeight && box.right <= innerWidth;
  const above = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
  return within && above === stop ? performance.now() : 0;
}"""
"""Milliseconds since navigation, once STOP is enabled, uncovered and whole on the screen without scrolling."""
HEADERS = {"X-Autotune-Token": "none", "Content-Type": "application/json"}


# --- the run, in its own process --------------------------------------------------------------------------------------


def as_run(arguments: list[str]) -> int:
    from gcs_autotune.cli.remote import RemoteObserver, RemoteOperator

    uri, out = (next(a for a in arguments if a.startswith(k)).partition("=")[2] for k in ("--connect=", "--out="))
    Path(out).mkdir(parents=True)
    with RemoteObserver(sys.stdout.buffer) as observer:
        operator = RemoteOperator(observer, sys.stdin.fileno())
        if uri.startswith("tcp:"):
            _stops(uri, Path(out), operator, observer)
        else:
            _ticks(uri, Path(out), operator, observer)
    return 0


def _ticks(uri: str, out: Path, operator: Any, observer: Any) -> None:
    """Send a tick every 40 ms, or those of an hour at full speed; record the delay and duration of each."""
    from gcs_autotune.observer import Progress, SilentObserver

    listener = SilentObserver() if "silent" in uri else observer
    hour = "hour" in uri
    late, took = [], []
    begun = time.monotonic()
    ticks = 0
    while not operator.stop_requested() and (not hour or ticks < HOUR):
        ticks += 1
        due = begun + TICK * ticks
        if hour:
            time.sleep(0.02 if ticks % 50 == 0 else 0.0)
        else:
            time.sleep(max(due - time.monotonic(), 0.0))
        now = time.monotonic()
        late.append(now - due)
        t = ticks * TICK
        progress = Progress(
            "first self-oscillation", "relay", t, "psi", 0.1 * (ticks % 40), 1.0, 0.3, step=3, steps=8, x=t
        )
        listener.update(progress)
        took.append(time.monotonic() - now)
    (out / "late.json").write_text(json.dumps({"late": late, "took": took}))


def _stops(uri: str, out: Path, operator: Any, observer: Any) -> None:
    """Alternate the rudder with the real sequencer until STOP; record the time of the first neutral override."""
    from gcs_autotune.craft import Actuate
    from gcs_autotune.errors import OperatorStopped
    from gcs_autotune.manoeuvres import Envelope, Manoeuvre, Sequencer
    from gcs_autotune.workflow.connection import connect_craft
    from gcs_autotune.workflow.record import RunDirectory
    from gcs_autotune.workflow.settings import CommonSettings, Connection

    class AlternatingRudder(Manoeuvre):
        """Half rudder to alternate sides, every 0.2 s."""

        kind, purpose, signal, force, in_manual, name = "alternating", "benchmark", "psi", "N", True, "alternating"

        @property
        def meta_fields(self) -> dict[str, float]:
            return {}

        def commands(self, now: Any) -> Any:
            while True:
                now = yield Actuate(N=0.5 if now.t % 0.4 < 0.2 else -0.5)

    record = RunDirectory(out)
    with connect_craft(CommonSettings(Connection(uri), out), operator, observer, record, "heading") as craft:
        sent: list[float] = []  # time of the first neutral override after the last other one
        send = craft.session.send

        def timed(message: Any) -> None:
            send(message)
            if message.get_type() == "RC_CHANNELS_OVERRIDE":
                sent[:] = [*sent[:1], time.monotonic()][:1] if message.chan1_raw == 1500 else []

        craft.session.send = timed
        craft.arm()
        sequencer = Sequencer(craft, Envelope(), observer, lambda trial: None)
        while not (out / "enough").exists():
            observer.say("alternating")
            try:
                sequencer.fly(AlternatingRudder(), "alternating")
            except OperatorStopped:
                neutral = sent[:]
                sequencer.go_on()
            operator._stop = craft.session.operator.requested = False
            observer.say("neutral " + json.dumps(neutral))
        craft.disarm()


# --- the server and its viewers ---------------------------------------------------------------------------------------


class Server:
    """``gcs-autotune serve`` with this file as its program."""

    def __init__(self, runs: Path) -> None:
        self.runs = runs
        self.process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.web_page", "--as-server", str(runs)], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline().split("/")[2].rpartition(":")[2])

    def post(self, where: str, what: dict[str, Any], connection: http.client.HTTPConnection | None = None) -> Any:
        connection = connection or http.client.HTTPConnection("127.0.0.1", self.port)
        connection.request("POST", where, json.dumps(what), HEADERS)
        return json.loads(connection.getresponse().read())

    def start(self, uri: str) -> Path:
        return self.runs / self.post("/start", {"job": "tune", "axis": "heading", "connect": uri})["name"]

    def processor(self) -> float:
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def memory(self) -> float:
        """Return the resident memory [MB]."""
        return int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(60.0)


class Viewers:
    """A number of sockets that read all data, in a thread."""

    def __init__(self, port: int, count: int) -> None:
        self.messages = self.bytes = 0
        self.texts: list[str] = []
        self._news = threading.Condition()
        self._loop = asyncio.new_event_loop()
        self._port, self._count = port, count
        threading.Thread(target=self._loop.run_until_complete, args=(self._all(),), daemon=True).start()

    async def _all(self) -> None:
        await asyncio.gather(*(self._one(k) for k in range(self._count)))

    async def _one(self, number: int) -> None:
        from websockets.asyncio.client import connect
        from websockets.exceptions import ConnectionClosed

        async with connect(f"ws://127.0.0.1:{self._port}/live", max_size=None, compression=None) as socket:
            while True:
                try:
                    text = await socket.recv()
                except ConnectionClosed:
                    return
                self.messages += 1
                self.bytes += len(text)
                if number == 0:
                    message = json.loads(text)
                    words_of_end = [{"text": f"ended: {message['end']['reason']}"}] if message.get("end") else []
                    words = [*message.get("+words", ()), *message.get("whole", {}).get("words", ()), *words_of_end]
                    with self._news:
                        self.texts += [w["text"] for w in words]
                        self._news.notify_all()

    def wait_for(self, beginning: str, after: int) -> tuple[str, int]:
        """Return the first text after number *after* with this beginning, and its number."""
        with self._news:
            while True:
                found = [k for k in range(after, len(self.texts)) if self.texts[k].startswith(beginning)]
                if found:
                    return self.texts[found[0]], found[0] + 1
                assert self._news.wait(30.0), f"'{beginning}' was not received; last {self.texts[-3:]}"


class Page:
    """The page in Chromium."""

    def __init__(self, page: Any) -> None:
        self._page = page
        self._tools = page.context.new_cdp_session(page)
        self._tools.send("Performance.enable")
        page.evaluate(CLICKED)

    def memory(self) -> float:
        """Return the memory of its script after garbage collection [MB]."""
        self._tools.send("HeapProfiler.collectGarbage")
        message = {m["name"]: m["value"] for m in self._tools.send("Performance.getMetrics")["metrics"]}
        return float(message["JSHeapUsedSize"]) / 1e6

    def open_on_phone(self, port: int) -> float:
        """Open the page as a slow phone does; return the time from navigation until STOP can be pressed [s]."""
        self._page.set_viewport_size(PHONE)
        self._tools.send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
        self._page.goto("about:blank")
        self._page.goto(f"http://127.0.0.1:{port}/", wait_until="commit")
        seen = float(self._page.wait_for_function(STOP_SEEN).json_value())
        self._page.evaluate(CLICKED)
        return seen / 1e3

    def stop(self) -> float:
        """Click on STOP and return the time of the click (``time.monotonic``)."""
        self._page.click("#stop")
        return float(self._page.evaluate("window.clicked")) / 1e3 - (time.time() - time.monotonic())


@contextmanager
def chromium(port: int, *, is_open: bool) -> Iterator[Page | None]:
    """Yield the page of the server at *port* in Chromium, or None if not *is_open*."""
    if not is_open:
        yield None
        return
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{port}/")
        yield Page(page)
        browser.close()


def thirds(sizes: list[float]) -> str:
    """Return a summary of *sizes* [MB] over time."""
    third = max(len(sizes) // 3, 1)
    second, last = max(sizes[third : 2 * third]), max(sizes[2 * third :])
    return f"{sizes[0]:.1f} MB at first, at most {second:.1f} in the second third and {last:.1f} in the last"


def cost(seconds: float, viewers: int, *, in_browser: bool) -> list[Figure]:
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder))
        found = {}
        for what in ("silent", "reported"):
            watching = Viewers(server.port, viewers if what == "reported" else 0)
            out = server.start(f"udpin:{what}")
            time.sleep(2.0)
            before, begun, messages = server.processor(), time.monotonic(), watching.messages
            time.sleep(seconds)
            share = 100.0 * (server.processor() - before) / (time.monotonic() - begun)
            rate = (watching.messages - messages) / seconds / viewers
            server.post("/stop", {})
            while not (out / "late.json").exists():
                time.sleep(0.1)
            time.sleep(0.5)
            found[what] = json.loads((out / "late.json").read_text())
        late = {what: sorted(1e3 * x for x in each["late"]) for what, each in found.items()}
        took = sorted(1e6 * x for x in found["reported"]["took"])
        print(f"server, {viewers} viewers at {rate:.1f} Hz: {share:.2f} % of a core (goal 3)")
        for what, each in late.items():
            print(f"tick late, {what}: median {each[len(each) // 2]:.2f} ms, 99 % {each[int(0.99 * len(each))]:.2f}, "
                  f"worst {each[-1]:.2f} of {len(each)}")  # fmt: skip
        print(f"sending a tick: median {took[len(took) // 2]:.0f} us, worst {took[-1]:.0f} (goal: 5 ms late at most)")
        watching = Viewers(server.port, viewers)
        with chromium(server.port, is_open=in_browser) as page:
            out = server.start("udpin:hour")
            sizes, shown = [], []
            while not (out / "late.json").exists():
                time.sleep(0.5)
                sizes.append(server.memory())
                shown += [page.memory()] if page is not None else []
        print(f"memory over an hour's ticks, server: {thirds(sizes)}; {watching.bytes / 1e6:.0f} MB sent")
        if shown:
            print(f"memory over an hour's ticks, page in Chromium: {thirds(shown)}")
        server.close()
    later = late["reported"][-1] - late["silent"][-1]
    return [
        Figure(f"processor at {rate:.0f} Hz with {viewers} viewers", share, "%", most=3.0),
        Figure("worst lateness of a tick, more than without the page", later, "ms", most=5.0),
    ]


def stops(count: int, viewers: int, *, in_browser: bool, on_phone: bool = False) -> list[Figure]:
    vehicle = subprocess.Popen(
        [sys.executable, "-m", "sitl", "charlie", "--listen", "tcp:127.0.0.1:5797"], stdout=subprocess.DEVNULL
    )
    try:
        with tempfile.TemporaryDirectory() as folder:
            server = Server(Path(folder))
            watching = Viewers(server.port, viewers)
            time.sleep(2.0)
            with chromium(server.port, is_open=in_browser) as page:
                out = server.start("tcp:127.0.0.1:5797")
                connection = http.client.HTTPConnection("127.0.0.1", server.port)
                delays, opened, heard = [], [], 0
                for k in range(count):
                    _, heard = watching.wait_for("alternating", heard)
                    if page is not None and on_phone:
                        opened.append(page.open_on_phone(server.port))
                    time.sleep(0.3 + 0.013 * (k % 31))  # at any point of a tick
                    begun = time.monotonic() if page is None else page.stop()
                    if page is None:
                        server.post("/stop", {}, connection)
                    if k == count - 1:
                        (out / "enough").touch()
                    text, heard = watching.wait_for("neutral ", heard)
                    (sent,) = json.loads(text.partition(" ")[2])
                    delays.append(1e3 * (sent - begun))
            delays.sort()
            since = "POST" if page is None else "click in Chromium"
            print(f"STOP, from the {since} to the first neutral override on the wire: "
                  f"median {delays[count // 2]:.1f} ms, worst {delays[-1]:.1f} of {count} (goal 50)")  # fmt: skip
            server.close()
    finally:
        vehicle.terminate()
        vehicle.wait(10.0)
    if on_phone:
        median, worst = sorted(opened)[count // 2], max(opened)
        print(f"phone, page opened until STOP can be pressed: median {median:.2f} s, worst {worst:.2f} of {count}")
        seen = Figure(f"phone: page opened to STOP ready, worst of {count}", worst, "s", most=2.0)
        return [seen, Figure(f"phone: click to neutral, worst of {count}", delays[-1], "ms")]
    return [
        Figure(f"STOP to neutral, worst of {count}", delays[-1], "ms", most=50.0),
        Figure("STOP to neutral, median", delays[count // 2], "ms"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--stops", type=int, default=20)
    parser.add_argument("--viewers", type=int, default=4)
    parser.add_argument(
        "--browser", action="store_true", help="also open the page in Chromium; the time to STOP starts at a click"
    )
    parser.add_argument("--phone", action="store_true", help="only the time until a phone can stop a run")
    args = parser.parse_args()
    if args.phone:
        measured = stops(args.stops, args.viewers, in_browser=True, on_phone=True)
        headline("web_page_phone", "time until a phone can stop a run", measured)
        return
    static = Path("gcs_autotune/web/static")
    sizes = sum(p.stat().st_size for p in static.iterdir())
    print(f"page: {sizes / 1e3:.1f} kB in {len(list(static.iterdir()))} files (goal 300)")
    spent = cost(args.seconds, args.viewers, in_browser=args.browser)
    stopped = stops(args.stops, args.viewers, in_browser=args.browser)
    size = Figure("page size", sizes / 1e3, "kB", most=300.0)
    headline("web_page", "response time and processor load of the page of serve", [*stopped, *spent, size])


if __name__ == "__main__":
    if sys.argv[1:2] == ["--as-run"]:
        sys.exit(as_run(sys.argv[2:]))
    if sys.argv[1:2] == ["--as-server"]:
        from gcs_autotune.web import CommandLine, ServeSettings, serve

        program = CommandLine((sys.executable, "-m", "benchmarks.web_page", "--as-run"))
        serve(ServeSettings("127.0.0.1", 0, Path(sys.argv[2])), lambda text: print(text, flush=True), program)
    else:
        main()
