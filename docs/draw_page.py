"""Draw the README's picture of the live page, during a tune flown over a link (needs Chromium):

python3 docs/draw_page.py docs/pictures/page.png
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image, PngImagePlugin

ROOT = Path(__file__).parents[1]
STATIC = ROOT / "gcs_autotune" / "web" / "static"
PICTURE = ROOT / "docs" / "pictures" / "page.png"
MADE_OF = ("index.html", "page.css", "main.js", "charts.js")
KEY = "page"
"""Name of the entry in the picture that identifies the page it was drawn from."""
PORT = 5767
WAIT = 100_000.0


def fingerprint() -> str:
    """Return what the page is made of now, in short."""
    whole = b"".join((STATIC / name).read_bytes() for name in MADE_OF)
    return hashlib.sha256(whole).hexdigest()[:16]


def drawn_of(picture: Path = PICTURE) -> str:
    """Return what the page was made of when *picture* was drawn."""
    with Image.open(picture) as image:
        return str(image.info.get(KEY, ""))


@contextmanager
def running(words: list[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Run the program *words* with its standard error in a pipe, and end it with the context, after an error too."""
    with subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, **options) as process:
        try:
            yield process
        finally:
            process.terminate()


def main(picture: Path) -> None:
    """Fly a tune of a simulated boat six times as fast as the clock, and take the page in its self-oscillation."""
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    vehicle = [sys.executable, "-m", "sitl", "charlie", "--listen", f"tcp:127.0.0.1:{PORT}", "--speedup", "6"]
    with (
        tempfile.TemporaryDirectory() as runs,
        running(vehicle) as boat,
        running(
            [sys.executable, "-m", "gcs_autotune", "serve", "--port", "0", "--runs", runs],
            env={**os.environ, "XDG_STATE_HOME": runs},  # an interrupted run of this machine would end the tune
            text=True,
        ) as server,
        sync_playwright() as playwright,
    ):
        assert boat.stderr is not None and server.stderr is not None
        boat.stderr.readline()
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1180, "height": 1010}, color_scheme="light")
        page.goto(server.stderr.readline().split()[1])
        page.click("#tab-start")
        page.select_option("#job", "tune")
        page.fill("#connect", f"tcp:127.0.0.1:{PORT}")
        page.click("#start")
        page.click("#yes", timeout=WAIT)
        page.locator("#stage", has_text="self-oscillation").wait_for(timeout=WAIT)
        page.locator("#tile-periods", has_text="1 of").wait_for(timeout=WAIT)
        page.evaluate("scrollTo(0, 0)")
        page.screenshot(path=picture)
        page.click("#stop")
        page.locator("#end").wait_for(timeout=WAIT)
        browser.close()
    note = PngImagePlugin.PngInfo()
    note.add_text(KEY, fingerprint())
    with Image.open(picture) as image:
        image.convert("RGB").quantize(128).save(picture, pnginfo=note, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
