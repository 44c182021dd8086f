"""A browser without a screen, in which pages are photographed."""

import shutil
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from imageio.v3 import imread, imwrite

OUT = Path("out/viewer")
SIZE = (720, 480)
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
"""WebGL on the processor."""
LONG = 120.0
"""Seconds that a page may take on a machine that does other work, too."""


@pytest.fixture(scope="session")
def browser():
    """Chromium: the system's, or the one that `playwright install chromium` brought."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        own = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        opened = playwright.chromium.launch(executable_path=own, args=SOFTWARE)
        yield opened
        opened.close()


@pytest.fixture
def page_of(browser, request):
    """Opens a view's page; `photograph()` gives what is to be seen of the scene: (480, 720, 3) int, kept in out/viewer."""
    pages = []

    def open_page(url):
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        page.set_default_timeout(1000 * LONG)
        pages.append(page)
        page.goto(url)
        page.get_by_text("Show", exact=True).wait_for()
        return page

    yield open_page
    for page in pages:
        page.close()


@pytest.fixture
def photograph(request):
    """What the canvas of a page shows once it does not change any more: (480, 720, 3) int, kept in out/viewer."""
    taken = []

    def take(page):
        OUT.mkdir(parents=True, exist_ok=True)
        file = OUT / f"{request.node.name}-{len(taken)}.png"
        before, until = None, time.monotonic() + LONG
        while True:
            # The canvas alone, without the panel above it.
            page.add_style_tag(content="body *:not(canvas):not(:has(canvas)) { visibility: hidden !important }")
            page.screenshot(path=file, timeout=1000 * LONG)
            picture = imread(file)[..., :3].astype(int)
            if before is not None and np.array_equal(picture, before) and np.ptp(picture) > 100:
                break
            assert time.monotonic() < until, "the picture is blank, or does not come to rest"
            before = picture
            time.sleep(0.5)
        taken.append(file)
        imwrite(file, picture.astype(np.uint8))
        return picture

    return take


@pytest.fixture
def in_background():
    """Runs a view in a thread until the test ends."""
    running = []

    def start(view, *arguments):
        thread = threading.Thread(target=view.run, args=arguments)
        thread.start()
        running.append((view, thread))

    yield start
    for view, thread in running:
        view.close()
        thread.join(LONG)
        assert not thread.is_alive()
