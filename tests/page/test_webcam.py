"""Images of a webcam: hands are found, fitted and followed; what is no image is refused."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float, UInt8
from PIL import Image
from starlette.testclient import TestClient

from hand_recon.detection.detector import DetectedHand, Detections
from hand_recon.detection.models import ModelsError
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.page.bounds import Bounds
from hand_recon.page.knowledge_rows import ROWS, row_config
from hand_recon.page.live_view import LiveView, decoded_image
from hand_recon.page.routes import PageSettings, page_app
from hand_recon.page.worker import TookTooLongError
from hand_recon.runs.clip.live_hands import WORTH_SHOWING
from tests.support.moving_hands import open_hand
from tests.support.page_server import DirectWorker, demo_config

HERE = "http://127.0.0.1:8765"
BOUNDS = Bounds(frame_bytes=50_000, frame_pixels=640 * 480)


class OneHand:
    """Finds an open left hand that moves to the right, in every image."""

    name = "scripted"

    def __init__(self) -> None:
        self.images = 0

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        points: Float[np.ndarray, "landmark=21 2"] = open_hand(2.0, "left")
        points = points + np.array([320.0 + 4 * self.images, 380.0])
        self.images += 1
        return Detections((DetectedHand(points, "left", 0.98, 0.99, sigma=np.full(21, 2.0)),))


def jpeg(width: int = 640, height: int = 480) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (width, height), (90, 80, 70)).save(stream, "JPEG")
    return stream.getvalue()


def larger(side: int) -> bytes:
    """A JPEG file that claims to have this width and height."""
    content = jpeg()
    place = content.index(b"\xff\xc0") + 5
    return content[:place] + 2 * side.to_bytes(2, "big") + content[place + 4 :]


@pytest.fixture(scope="module")
def view(hand: HandModel) -> LiveView:
    """A webcam before an open left hand, after two images."""
    config = row_config(ROWS[-1], demo_config())
    found = LiveView(config, hand, OneHand(), load_ranges("literature"))
    for _ in range(WORTH_SHOWING - 1):
        assert found(decoded_image(jpeg(), BOUNDS))["hands"] == []
    return found


def test_a_hand_is_shown_once_it_was_seen_in_three_images_and_follows_its_landmarks(
    view: LiveView,
) -> None:
    found = [view(decoded_image(jpeg(), BOUNDS)) for _ in range(3)]
    assert [one["size"] for one in found] == [[640, 480]] * 3
    entries = [one["hands"][0]["entry"] for one in found]
    assert {(entry["side"], entry["clip"]["hand"]) for entry in entries} == {("left", 1)}
    assert [entry["clip"]["frame"] for entry in entries] == [2, 3, 4]
    middles = [np.mean(entry["landmarks_2d"], axis=0)[0] for entry in entries]
    assert middles[0] < middles[1] < middles[2]
    assert max(entry["residual"] for entry in entries) < 15
    assert all("mesh" in one["hands"][0] for one in found)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "0 bytes, is no whole JPEG image"),
        (b"GIF89a" + bytes(90), "96 bytes, is no whole JPEG"),
        (jpeg()[:200], "200 bytes, is no whole JPEG"),
        (jpeg(641, 480), r"641 × 480 pixels; expected at most 0\.3 megapixels"),
        (larger(10_000), r"more pixels than Pillow opens; expected at most 0\.3 megapixels"),
        (larger(60_000), r"more pixels than Pillow opens; expected at most 0\.3 megapixels"),
    ],
)
def test_what_is_no_image_of_a_webcam_is_refused(content: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        decoded_image(content, BOUNDS)


class Scripted:
    """Answers images with their number, and says which were told to be the first."""

    def __init__(self) -> None:
        self.firsts: list[bool] = []

    def live(self, content: bytes, *, is_first: bool) -> dict[str, Any]:
        if content in (b"", b"bad"):
            raise ValueError("This is no image.")
        self.firsts.append(is_first)
        if content == b"slow":
            raise TookTooLongError("This took longer than 30 seconds.")
        if content == b"fetch":
            raise ModelsError("The hand detector's models are not here and cannot be fetched.")
        if content == b"odd":
            raise ZeroDivisionError("by zero")
        return {"hands": len(self.firsts)}


@pytest.fixture
def scripted() -> Scripted:
    return Scripted()


@pytest.fixture
def client(scripted: Scripted) -> Iterator[TestClient]:
    app = page_app(DirectWorker(scripted), PageSettings(bounds=BOUNDS))
    with TestClient(app, base_url=HERE) as found:
        yield found


def test_every_image_has_one_answer_and_a_bad_one_ends_nothing(
    client: TestClient, scripted: Scripted
) -> None:
    with client.websocket_connect("/api/live", headers={"host": "127.0.0.1"}) as socket:
        for content, answer in (
            (b"bad", {"error": "This is no image."}),
            (b"image", {"hands": 1}),
            (b"image", {"hands": 2}),
            (b"slow", {"error": "This took longer than 30 seconds."}),
            (b"image", {"hands": 4}),
            (
                bytes(50_001),
                {
                    "error": "The webcam's image has 50001 bytes; expected at most 50000. Send a smaller "
                    "one."
                },
            ),
            (b"image", {"hands": 5}),
        ):
            socket.send_bytes(content)
            assert socket.receive_json() == answer
        # A text is no image.
        socket.send_text("image")
        assert socket.receive_json() == {"error": "This is no image."}
    # After an image that took too long, a new process begins anew.
    assert scripted.firsts == [True, False, False, True, False]


def test_an_error_that_nobody_thought_of_is_told_and_does_not_end_the_connection(
    client: TestClient, scripted: Scripted
) -> None:
    with client.websocket_connect("/api/live", headers={"host": "127.0.0.1"}) as socket:
        socket.send_bytes(b"odd")
        assert (
            "(ZeroDivisionError: by zero). Start the webcam again" in socket.receive_json()["error"]
        )
        socket.send_bytes(b"image")
        assert socket.receive_json() == {"hands": 2}
    assert scripted.firsts == [True, True]


def test_models_that_cannot_be_fetched_are_told_in_their_own_words(client: TestClient) -> None:
    with client.websocket_connect("/api/live", headers={"host": "127.0.0.1"}) as socket:
        socket.send_bytes(b"fetch")
        assert socket.receive_json() == {
            "error": "The hand detector's models are not here and cannot be fetched."
        }


def test_one_page_at_a_time_has_the_webcam_and_the_next_has_it_afterwards(
    client: TestClient,
) -> None:
    headers = {"host": "127.0.0.1"}
    with client.websocket_connect("/api/live", headers=headers) as first:
        first.send_bytes(b"image")
        assert first.receive_json() == {"hands": 1}
        with client.websocket_connect("/api/live", headers=headers) as second:
            assert second.receive_json()["error"].startswith("Another page uses its camera")
    with client.websocket_connect("/api/live", headers=headers) as third:
        third.send_bytes(b"image")
        assert third.receive_json() == {"hands": 2}


def test_a_page_that_stops_and_starts_again_has_the_webcam(
    client: TestClient, scripted: Scripted
) -> None:
    """The connection before ends a moment later, when its last image is done."""
    headers = {"host": "127.0.0.1"}
    with (
        client.websocket_connect("/api/live", headers=headers) as first,
        client.websocket_connect("/api/live", headers=headers) as second,
    ):
        second.send_bytes(b"image")
        first.close()
        assert second.receive_json() == {"hands": 1}
    assert scripted.firsts == [True]


def test_a_detector_of_files_is_refused_for_a_webcam(hand: HandModel) -> None:
    config = row_config(ROWS[-1], demo_config("detector=landmarks", "detector.landmarks=a.json"))
    with pytest.raises(ValueError, match="detector=landmarks looks hands up by the file"):
        LiveView(config, hand, OneHand(), load_ranges("literature"))
