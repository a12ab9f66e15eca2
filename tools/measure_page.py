"""Time from a dropped photograph to its hand on the page, in a real browser: `python -m tools.measure_page`.

It needs Chromium and the extra `browser`. With `--images docs/images` it draws the images of docs/demo.md.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.support.browser_page import ROOT, camera_file, open_browser, served

EXAMPLES = ROOT / "examples"


@contextmanager
def opened(address: str) -> Iterator[Any]:
    """The page of an address in a browser of 1280 × 800 pixels, with a fake camera.

    Args:
        address: Address of the page.
    """
    with tempfile.TemporaryDirectory() as folder:
        camera = camera_file(Path(folder) / "camera.mjpeg", EXAMPLES / "hand.jpg")
        with open_browser(camera) as browser:
            context = browser.new_context(
                viewport={"width": 1280, "height": 800}, permissions=["camera"]
            )
            page = context.new_page()
            page.goto(address)
            page.wait_for_selector("body[data-ready]")
            yield page


def times_of(page: Any, photograph: Path) -> tuple[float, float]:  # noqa: ANN401
    """Drop a photograph, and wait for its hand and for the fits of all rows.

    Args:
        page: The page.
        photograph: The photograph.

    Returns:
        Seconds to the hand, and to all rows.
    """
    page.evaluate("() => { document.querySelector('#facts').hidden = true; }")
    begun = time.perf_counter()
    page.set_input_files("#file", photograph)
    page.wait_for_selector("#facts:not([hidden])")
    hand = time.perf_counter() - begun
    page.wait_for_selector("#rows input[value=none]:enabled")
    return hand, time.perf_counter() - begun


def draw(page: Any, folder: Path) -> None:  # noqa: ANN401
    """Draw the screenshots: a photograph with its hand, and the same hand without knowledge.

    Args:
        page: The page.
        folder: Folder to write to.
    """
    times_of(page, EXAMPLES / "two_hands.jpg")
    page.wait_for_timeout(800)
    page.screenshot(path=folder / "page_photo.jpg", type="jpeg", quality=66)
    times_of(page, EXAMPLES / "hand.jpg")
    page.check("#rows input[value=none]", force=True)
    page.wait_for_timeout(800)
    page.screenshot(path=folder / "page_knowledge.jpg", type="jpeg", quality=66)


def main(words: Sequence[str] | None = None) -> None:
    """Print the medians, or draw the screenshots.

    Args:
        words: The command line; none for this process's own.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--times", type=int, default=10, help="drops of each photograph")
    parser.add_argument("--images", type=Path, help="draw the screenshots into this folder instead")
    asked = parser.parse_args(words)
    with served() as address, opened(address) as page:
        if asked.images is not None:
            draw(page, asked.images)
            return
        for photograph in (EXAMPLES / "hand.jpg", EXAMPLES / "two_hands.jpg"):
            found = [times_of(page, photograph) for _ in range(asked.times)]
            hands, rows = zip(*found, strict=True)
            print(
                f"{photograph.name}: hand {statistics.median(hands):.2f} s (most {max(hands):.2f}), "
                f"all rows {statistics.median(rows):.2f} s"
            )


if __name__ == "__main__":
    main()
