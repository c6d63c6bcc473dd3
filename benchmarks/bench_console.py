"""Drag to redrawn chart in the console's loop view, and frames of its scope, by the page's own clock.

The server is a process of its own, `tactuator console` on a display of three channels, each with a family of eight
models under two loads: 24 plants. Chromium drags the gain, a zero, and a point of the Nichols curve by mouse; a time
runs from the first pointer event that a frame answers to the animation frame after it is drawn. The peer is the same
page with nothing to compute: the connection's answer to a request that it refuses.

The scope shows three channels at 4 kHz of the simulated rig: frames drawn a second, share of a core that the server and
the process of the rig take, and samples lost by their numbers. Its peer is the rate at which the page is given frames
to draw when it does nothing else.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from tactuator.io.shipped import EXAMPLES

MOVES = 120
SCOPE_S = 20
GOAL_MS = {"median": 50.0, "p95": 100.0}
PROGRAM = "import sys; from tactuator.cli import main; sys.exit(main())"
ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"]
CHANNELS = (("index", 2875.0, 94.0, 290.0), ("thumb", 2650.0, 101.0, 310.0), ("middle", 3020.0, 88.0, 275.0))
DISPLAY = """
[display]
name = "three channels, families of eight, two loads"
rate_hz = 4000
delay_samples = 1
[threshold]
curve = "bolanowski-1988"
"""
ECHO = """async () => {
  const { Link } = await import("/static/link.js");
  const link = new Link(sessionStorage.getItem("token"), () => {}, () => {}), times = [];
  await new Promise((resolve) => setTimeout(resolve, 500));
  for (let i = 0; i < 100; i += 1) {
    const began = performance.now();
    await link.ask("start").catch(() => {});
    times.push(performance.now() - began);
  }
  return times;
}"""


def display_text() -> str:
    """Return the display file; the models of a family differ in gain and in their faster pole."""
    text = DISPLAY
    for name, num, first, last in CHANNELS:
        family = [
            f"{{ num = [{num * (1.0 + 0.02 * k):g}], den = [1.0, {first * (1.0 + 0.015 * k):g}, {last:g}] }}"
            for k in range(-3, 5)
            if k != 0
        ]
        text += f"""
[[channel]]
name = "{name}"
finger = "{name}"
sensor_gain_v_per_mm = 0.2
travel_mm = 12.5
plant = {{ num = [{num:g}], den = [1.0, {first:g}, {last:g}] }}
family = [{", ".join(family)}]
loads = [
  {{ name = "finger", mass = 0.12, damping = 31.0, stiffness = 360.0 }},
  {{ name = "light", mass = 0.05, damping = 12.0, stiffness = 140.0 }},
]
"""
    return text


@contextmanager
def served(path: Path, *more: str) -> Iterator[tuple[str, int]]:
    """Serve the console for a display file; yield its address and the id of its process."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", PROGRAM, "console", str(path), "--port", "0", *more]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    try:
        yield process.stderr.readline().split()[1], process.pid
    finally:
        process.terminate()
        process.wait(timeout=60)


def dragged(page: Page, selector: str, across: float, up: float) -> dict[str, float]:
    """Drag a handle by mouse, and return the times of the frames, ms."""
    page.evaluate("window.consoleLatencies.length = 0")
    box = page.locator(selector).first.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    for move in range(1, MOVES + 1):
        share = float(np.sin(2.0 * np.pi * move / MOVES))
        page.mouse.move(x + across * share, y - up * share)
        page.wait_for_timeout(16)
    page.mouse.up()
    page.wait_for_timeout(300)
    return summary(page.evaluate("window.consoleLatencies"))


def summary(times_ms: list[float]) -> dict[str, float]:
    values = np.array(times_ms)
    return {
        "frames": float(values.size),
        "median_ms": float(np.median(values)),
        "p95_ms": float(np.percentile(values, 95.0)),
    }


def run() -> dict[str, object]:
    """Return the times of three kinds of drag, of the connection alone, and what the first page transfers."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "display.toml"
        path.write_text(display_text())
        chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        with served(path) as (address, _):
            page = browser.new_page(viewport={"width": 1366, "height": 860})
            page.goto(address)
            page.wait_for_selector("body[data-ready=start]")
            page.reload()
            page.wait_for_selector("body[data-ready=start]")
            first = json.loads(page.evaluate(FIRST))
            page.click(".cards a")
            page.wait_for_selector(".tiles[aria-busy=false]", timeout=60_000)
            found: dict[str, object] = {
                "gain": dragged(page, ".handle.gain", 0.0, 30.0),
                "zero": dragged(page, ".handle >> nth=1", 40.0, 0.0),
                "point of the curve": dragged(page, ".mark >> nth=3", 15.0, 20.0),
                "connection alone": summary(page.evaluate(ECHO)),
                "first page": first,
                "goal_ms": GOAL_MS,
            }
        found["scope"] = scope(browser)
        browser.close()
    return found


def scope(browser: Browser) -> dict[str, float]:
    """Return the figures of the scope on the simulated rig, while it plays noise on every channel."""
    with served(EXAMPLES / "display.toml", "--rig", "simulated") as (address, process):
        page = browser.new_page(viewport={"width": 1366, "height": 860})
        page.goto(f"{address}&view=scope")
        page.click("#use-design", timeout=60_000)
        page.click("#live:not([disabled])", timeout=120_000)
        for name, *_ in CHANNELS:
            page.check(f"#wave-on-{name}")
        page.select_option("#wave", "noise")
        page.click("#play:not([disabled])")
        page.wait_for_selector("#wave-now:has-text('noise')")
        before, began = cores(process), page.evaluate("[window.scopeFrames.length, window.scopeLast.end]")
        page.wait_for_timeout(1000 * SCOPE_S)
        after, ended = cores(process), page.evaluate("[window.scopeFrames.length, window.scopeLast.end]")
        return {
            "frames_a_second": (ended[0] - began[0]) / SCOPE_S,
            "idle_frames_a_second": page.evaluate(IDLE),
            "samples_a_second": (ended[1] - began[1]) / SCOPE_S,
            "samples_lost": page.evaluate("window.scopeLast.lost"),
            "pictures_left_out": page.evaluate("window.scopeLast.dropped"),
            "server_of_a_core": (after[0] - before[0]) / SCOPE_S,
            "rig_of_a_core": (after[1] - before[1]) / SCOPE_S,
        }


def cores(process: int) -> tuple[float, float]:
    """Return the seconds of processor time of a process, and of those that it began (Linux)."""
    times, parents = {}, {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            fields = (place / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(place.name)] = int(fields[1])
        times[int(place.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return times[process], sum(times[one] for one, parent in parents.items() if parent == process)


IDLE = """() => new Promise((done) => {
  const began = performance.now();
  let count = 0;
  const next = () => {
    count += 1;
    const passed = performance.now() - began;
    if (passed > 2000) done(1000 * count / passed); else requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
})"""
FIRST = """() => JSON.stringify({
  usable_ms: performance.getEntriesByName("usable")[0].startTime,
  transferred_kb: (performance.getEntriesByType("resource").reduce((sum, one) => sum + one.transferSize, 0)
    + performance.getEntriesByType("navigation")[0].transferSize) / 1000,
})"""
