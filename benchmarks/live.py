"""How fast a live page is: how soon it opens, how soon a changed value shows, how many frames it draws.

    make web && python benchmarks/live.py [TIMES]

The page is that of `uomodri`, with runs of 5 s and two controllers, in headless Chromium through
chromedriver, as the tests open it. Each number is the best of TIMES (5) tries or more, since other load only
makes a page slower. On a machine that is never quiet, look at the processor time: the busier worker's and the
page thread's together are the time to the picture on two free cores.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from browser import MISSING, Browser, browser

from cogless.live import write
from cogless.study import load

KEY = 'scenario.1-rev-s.override."mechanics.inertia"'  # this key changes both controllers' runs
WAIT = "return window.cogless ? cogless.isIdle() : false"
# Notes the time of the first picture, ms, in each page that is opened after this.
OPENED = """
const look = () => {
  if (window.cogless && cogless.isShown()) window.opened = performance.now();
  else requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
# STEP sets a value, and returns the time until its picture is drawn, ms. DRAG moves a slider for 2 s, and
# returns frames and new pictures a second.
STEP = """
const key = cogless.page.keys.find((key) => key.key === arguments[0]);
return new Promise((done) => {
  const begun = performance.now(), shown = () => {
    if (!cogless.isShown()) return requestAnimationFrame(shown);
    const ms = ["pi", "pi-ilc"].map((name) => cogless.result(name, false).result.ms);
    const most = (what) => Math.max(...ms.map((m) => m[what]));
    done([performance.now() - begun, most("engine"), most("all")]);
  };
  cogless.set(key.key, key.low + (key.high - key.low) * Math.random());
  requestAnimationFrame(shown);
});
"""
DRAG = """
const label = document.querySelector(`label[title=${JSON.stringify(arguments[0])}]`);
const range = label.parentElement.querySelector("input[type=range]");
const key = cogless.page.keys.find((key) => key.key === arguments[0]);
return new Promise((done) => {
  const begun = performance.now(), frames = [];
  let before = begun, pictures = 0, last = null;
  const frame = (now) => {
    frames.push(now - before);
    before = now;
    const run = cogless.result("pi-ilc", false);
    if (run !== last) { pictures += 1; last = run; }
    if (now - begun > 2000) {
      frames.sort((a, b) => a - b);
      const rate = (share) => 1000 / frames[Math.floor(share * frames.length)];
      return done([rate(0.5), rate(0.95), pictures / 2]);
    }
    range.value = key.low + (key.high - key.low) * (0.5 + 0.4 * Math.sin((now - begun) / 300));
    range.dispatchEvent(new Event("input"));
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
});
"""


def threads(profile: Path) -> dict[tuple[str, str], int]:
    """Processor time so far, ns, of each thread of this browser's pages, by name and number."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            arguments = (process / "cmdline").read_bytes().decode(errors="replace")
            if "--type=renderer" not in arguments or str(profile) not in arguments:
                continue
            for task in (process / "task").iterdir():
                spent = int((task / "schedstat").read_text().split()[0])
                name = "page" if task.name == process.name else (task / "comm").read_text().strip()
                found[name, task.name] = spent
        except OSError:  # the process has ended meanwhile
            continue
    return found


def spent(before: dict[tuple[str, str], int], after: dict[tuple[str, str], int]) -> tuple[float, float]:
    """Processor time of the page's thread and of its busiest worker between two moments, ms."""
    took = {key: (ns - before.get(key, 0)) / 1e6 for key, ns in after.items()}
    page = max((ms for (name, _), ms in took.items() if name == "page"), default=0.0)
    worker = max((ms for (name, _), ms in took.items() if "Worker" in name), default=0.0)
    return page, worker


def settled(shown: Browser) -> None:
    while not shown.run(WAIT):
        time.sleep(0.05)


def run(shown: Browser, script: str, *given: object) -> list[float]:
    found: list[float] = shown._post("/execute/sync", {"script": script, "args": list(given)})
    return found


def main() -> None:
    if MISSING:
        sys.exit(MISSING)
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    with tempfile.TemporaryDirectory() as folder, browser(Path(folder)) as shown:
        page = Path(folder) / "uomodri.html"
        write(load("uomodri", {"scenario.1-rev-s.duration": "5 s"}), page, "cogless run uomodri")
        print(f"size: {page.stat().st_size / 1e6:.2f} MB")
        shown.devtools("Page.addScriptToEvaluateOnNewDocument", source=OPENED)
        opened, steps, drags = [], [], []
        for _ in range(times):
            shown.devtools("Page.navigate", url="about:blank")
            shown.open(page, 1300)
            settled(shown)
            opened.append(run(shown, "return [window.opened]")[0])
            for _ in range(times):
                before = threads(Path(folder))
                step = run(shown, STEP, KEY)
                steps.append([*step, *spent(before, threads(Path(folder)))])
                settled(shown)
            drags.append(run(shown, DRAG, KEY))
            settled(shown)
    whole, engine, worker, own, others = (min(column) for column in zip(*steps, strict=True))
    print(f"opened, with its first picture: {min(opened):.0f} ms")
    print(
        f"a value changed, with the picture drawn: {whole:.0f} ms (engine {engine:.0f}, worker {worker:.0f})"
    )
    print(f"  processor time: {own + others:.0f} ms (the page {own:.0f}, the busier worker {others:.0f})")
    median, slow, pictures = (max(column) for column in zip(*drags, strict=True))
    print(
        f"dragging: {median:.0f} frames a second, 95 % above {slow:.0f}; {pictures:.1f} new pictures a second"
    )


if __name__ == "__main__":
    main()
