"""The page in a real browser: a photograph, the knowledge rows, a webcam, a clip, and refusals."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.fitting.hands_file import writing_hands
from hand_recon.hand.model import HandModel
from hand_recon.page.knowledge_rows import ROWS
from tests.support.browser_page import ROOT, camera_file, open_browser, served
from tests.support.detector_models import published_models
from tests.support.exported import records_of
from tests.support.trajectories import Clip, moving_hand

pytestmark = pytest.mark.slow

WAIT = 60_000
"""Longest time for a step on a busy machine, milliseconds."""

NO_CAMERA = """() => {
  navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException("", "NotFoundError"));
}"""
"""Script after which the page has no camera."""


@pytest.fixture(scope="module")
def results(hand: HandModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results: a clip of 90 frames."""
    folder = tmp_path_factory.mktemp("results")
    with writing_hands(folder / "hands.json") as write:
        write(records_of(moving_hand(clip=Clip(frames=90)), hand))
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    camera = tmp_path_factory.mktemp("camera") / "camera.mjpeg"
    with open_browser(camera_file(camera, ROOT / "examples" / "hand.jpg")) as found:
        yield found


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with served(f"detector.models={published_models()}", "bounds.megabytes=1") as found:
        yield found


def opened(browser: Any, address: str, width: int = 1280) -> tuple[Any, list[str]]:  # noqa: ANN401
    """The page, and the list that gets everything that goes wrong in it."""
    context = browser.new_context(
        viewport={"width": width, "height": 844 if width < 500 else 800}, permissions=["camera"]
    )
    page, wrong = context.new_page(), []
    page.set_default_timeout(WAIT)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "console",
        lambda message: wrong.append(message.text) if message.type == "error" else None,
    )
    page.on(
        "request",
        lambda asked: (
            None
            if asked.url.startswith((address, "data:", "blob:", address.replace("http", "ws")))
            else wrong.append(f"request of {asked.url}")
        ),
    )
    page.goto(address)
    page.wait_for_selector("body[data-ready]")
    return page, wrong


PIXELS = """
      const canvas = document.querySelector('#scene canvas');
      const copy = document.createElement('canvas');
      Object.assign(copy, { width: canvas.width, height: canvas.height });
      const context = copy.getContext('2d');
      context.drawImage(canvas, 0, 0);
      const { data } = context.getImageData(0, 0, copy.width, copy.height);"""
"""JavaScript that copies the 3D view, and has its bytes in `data`."""


def drawn_share(page: Any) -> float:  # noqa: ANN401
    """Share of the 3D view that something is drawn on."""
    share: float = page.evaluate(f"""() => {{
{PIXELS}
      let drawn = 0;
      for (let place = 3; place < data.length; place += 4) drawn += data[place] > 0;
      return drawn / (copy.width * copy.height);
    }}""")
    return share


def reddest(page: Any) -> float:  # noqa: ANN401
    """Largest difference of red and green in the 3D view, 0 to 255."""
    difference: float = page.evaluate(f"""() => {{
{PIXELS}
      let most = 0;
      for (let place = 0; place < data.length; place += 4) {{
        if (data[place + 3] === 255) most = Math.max(most, data[place] - data[place + 1]);
      }}
      return most;
    }}""")
    return difference


def test_a_photograph_becomes_a_hand_whose_knowledge_can_be_taken_away(
    browser: Any,  # noqa: ANN401
    address: str,
) -> None:
    page, wrong = opened(browser, address)
    page.set_input_files("#file", ROOT / "examples" / "hand.jpg")
    page.wait_for_selector("#facts:not([hidden])")
    assert page.inner_text("#hands h3").startswith("Right hand")
    assert page.locator("#overlay circle").count() == 21
    assert page.locator("#overlay ellipse").count() == 21
    assert 0.05 < drawn_share(page) < 0.6
    page.wait_for_selector("#rows input[value=none]:enabled")
    assert page.locator("#rows input").count() == len(ROWS)
    page.check("#rows input[value=natural]", force=True)
    page.wait_for_timeout(600)
    with_knowledge = reddest(page)
    page.focus("#rows input[value=natural]")
    for row in reversed(ROWS[:-1]):
        page.keyboard.press("ArrowLeft")
        assert page.locator("#rows input:checked").get_attribute("value") == row.key
    page.wait_for_timeout(600)
    assert "beyond, up to" in page.inner_text("#rows label:has(input[value=none])")
    assert "doubtful" in page.inner_text("#hands")
    # Joints beyond their limits are red.
    assert reddest(page) > with_knowledge + 40
    page.uncheck("#show-ellipses")
    assert page.locator("#overlay ellipse").count() == 0
    with page.expect_download() as download:
        page.click("#downloads a:has-text('glb')")
    assert Path(download.value.path()).read_bytes().startswith(b"glTF")
    assert wrong == []


def test_the_webcam_s_hand_is_followed_and_its_image_can_be_kept(
    browser: Any,  # noqa: ANN401
    address: str,
) -> None:
    page, wrong = opened(browser, address)
    page.click("#webcam")
    page.wait_for_selector("#facts:not([hidden])")
    assert page.inner_text("#hands h3").startswith("Right hand")
    assert page.locator("#stage.is-mirrored").count() == 1
    places = []
    for _ in range(4):
        places.append(float(page.locator("#overlay circle").first.get_attribute("cx")))
        page.wait_for_timeout(400)
    assert np.ptp(places) > 2
    assert "images per second" in page.inner_text("#status")
    # After the stop, the last image stays below its hand.
    page.click("#webcam")
    assert page.locator("#live").is_visible()
    assert page.locator("#stage.is-mirrored").count() == 1
    page.click("#webcam")
    page.wait_for_selector("#keep:not([hidden])")
    page.click("#keep")
    page.wait_for_selector("#ladder:not([hidden])")
    assert page.get_by_text("Use the webcam").is_visible()
    assert page.locator("#stage.is-mirrored").count() == 0
    assert wrong == []


def test_a_large_file_and_a_bad_one_are_refused_and_the_next_is_taken(
    browser: Any,  # noqa: ANN401
    address: str,
    tmp_path: Path,
) -> None:
    page, _ = opened(browser, address)
    large, bad = tmp_path / "large.jpg", tmp_path / "bad.jpg"
    large.write_bytes(bytes(1_000_001))
    bad.write_bytes(b"\xff\xd8\xff" + bytes(100))
    for file, words in ((large, "expected at most 1 MB"), (bad, "bad.jpg is a damaged JPEG file")):
        page.set_input_files("#file", file)
        page.wait_for_selector(f"#error:has-text('{words}')")
    page.set_input_files("#file", ROOT / "examples" / "two_hands.jpg")
    page.wait_for_selector("#facts:not([hidden])")
    assert page.locator("#error").is_hidden()
    assert page.locator(".hand-facts").count() == 2


def test_without_a_camera_the_hand_before_stays(browser: Any, address: str) -> None:  # noqa: ANN401
    page, wrong = opened(browser, address)
    page.set_input_files("#file", ROOT / "examples" / "hand.jpg")
    page.wait_for_selector("#rows input[value=none]:enabled")
    page.evaluate(NO_CAMERA)
    page.click("#webcam")
    page.wait_for_selector("#error:has-text('NotFoundError')")
    page.check("#rows input[value=ranges]", force=True)
    assert "Every joint stays inside the range" in page.inner_text("#row-sentence")
    assert page.locator("#photo").is_visible()
    assert wrong == []


def test_without_a_camera_the_clip_before_is_still_played(
    browser: Any,  # noqa: ANN401
    address: str,
    results: Path,
) -> None:
    page, wrong = opened(browser, address)
    page.set_input_files("#file", results / "hands.json")
    page.wait_for_selector("#player:not([hidden])")
    page.evaluate(NO_CAMERA)
    page.click("#webcam")
    page.wait_for_selector("#error:has-text('NotFoundError')")
    page.focus("#frame")
    page.keyboard.press("End")
    page.wait_for_selector("#frame-label:has-text('Frame 89')")
    assert wrong == []


def test_without_a_camera_a_file_that_is_worked_on_goes_on(browser: Any, address: str) -> None:  # noqa: ANN401
    page, _ = opened(browser, address)
    page.evaluate(NO_CAMERA)
    held: list[Any] = []
    page.route("**/api/file*", lambda route: held.append(route))  # Playwright marks functions
    page.set_input_files("#file", ROOT / "examples" / "hand.jpg")
    page.wait_for_selector("#working:not([hidden])")
    page.click("#webcam")
    page.wait_for_selector("#error:has-text('NotFoundError')")
    held[0].continue_()
    page.wait_for_selector("#facts:not([hidden]) .hand-facts")
    assert page.locator("#working").is_hidden()


def test_without_a_3d_view_the_rest_of_the_page_goes_on(browser: Any, address: str) -> None:  # noqa: ANN401
    context = browser.new_context()
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page = context.new_page()
    page.set_default_timeout(WAIT)
    page.goto(address)
    page.wait_for_selector("#error:has-text('has no WebGL')")
    page.set_input_files("#file", ROOT / "examples" / "hand.jpg")
    page.wait_for_selector("#facts:not([hidden])")
    assert page.inner_text("#scene-empty") == "No WebGL, and so no 3D view"
    assert page.inner_text("#hands h3").startswith("Right hand")
    assert page.locator("#overlay circle").count() == 21


def test_the_keyboard_s_place_is_shown_on_one_button(browser: Any, address: str) -> None:  # noqa: ANN401
    page, _ = opened(browser, address)
    page.keyboard.press("Tab")
    marked = page.evaluate("""() => [...document.querySelectorAll('.button')]
      .filter((one) => getComputedStyle(one).outlineStyle === 'solid').map((one) => one.textContent)""")
    assert marked == ["Open a file…"]


def test_a_clip_is_played(browser: Any, address: str, results: Path) -> None:  # noqa: ANN401
    page, wrong = opened(browser, address)
    page.set_input_files("#file", results / "hands.json")
    page.wait_for_selector("#player:not([hidden])")
    assert page.inner_text("#frame-label").startswith("Frame 0")
    page.click("#play")
    page.wait_for_function("() => Number(document.querySelector('#frame').value) > 20")
    page.click("#play")
    page.fill("#frame", "85")
    page.wait_for_function(
        "() => document.querySelector('#frame-label').textContent.startsWith('Frame 85')"
    )
    page.wait_for_timeout(500)
    assert drawn_share(page) > 0.005
    assert wrong == []


def test_the_page_fits_a_telephone(browser: Any, address: str) -> None:  # noqa: ANN401
    page, wrong = opened(browser, address, width=390)
    page.set_input_files("#file", ROOT / "examples" / "hand.jpg")
    page.wait_for_selector("#rows input[value=none]:enabled")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert wrong == []
