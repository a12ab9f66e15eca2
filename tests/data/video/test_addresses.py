"""Web addresses: files on a server are read whole, streams live, and passwords are not shown."""

import http.server
import threading
from collections.abc import Iterator
from functools import partial

import cv2
import pytest

from hand_recon.data.video.cameras import web_video, without_password
from hand_recon.data.video.files import VideoFile
from hand_recon.data.video.frames import VideoError
from hand_recon.data.video.live import LiveSource
from tests.support.video_files import FakeCapture, number_of, numbered_image, write_clip

BOUNDARY = "frame"


class Server(http.server.SimpleHTTPRequestHandler):
    """Files of a folder, and at `/camera` a stream of JPEG images as network cameras have it."""

    def do_GET(self) -> None:
        if self.path != "/camera":
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        self.end_headers()
        for number in range(30):
            image = cv2.imencode(".jpg", numbered_image(number)[..., ::-1])[1].tobytes()
            head = (
                f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n"
            )
            self.wfile.write(head.encode() + image + b"\r\n")

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("server")
    write_clip(folder / "clip.webm", count=12)
    (folder / "page.html").write_text("<html></html>")
    handler = partial(Server, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_a_file_on_a_server_is_read_whole_and_in_order(address: str) -> None:
    with web_video(f"{address}/clip.webm") as video:
        frames = list(video)
    assert not video.is_live
    assert [number_of(frame.pixels) for frame in frames] == list(range(12))
    assert frames[-1].time == pytest.approx(11 / 25, abs=1e-3)


def test_a_stream_of_images_is_live(address: str) -> None:
    with web_video(f"{address}/camera") as stream:
        numbers = [number_of(frame.pixels) for frame in stream]
    assert stream.is_live
    assert numbers == sorted(set(numbers))
    assert numbers


@pytest.mark.parametrize("path", ["missing.mp4", "page.html"])
def test_an_address_without_a_video_is_refused_in_words(address: str, path: str) -> None:
    with pytest.raises(
        VideoError, match=rf"{path} cannot be opened as a video\. Check the address"
    ):
        web_video(f"{address}/{path}")


def opened(address: str, **properties: float) -> LiveSource | VideoFile:
    source = web_video(address, opener=lambda _: FakeCapture([0.0], properties))
    assert isinstance(source, LiveSource | VideoFile)
    source.close()
    return source


def test_rtsp_is_live_whatever_number_of_frames_it_promises() -> None:
    assert opened("rtsp://10.0.0.2/stream", CAP_PROP_FRAME_COUNT=100.0).is_live
    assert opened("https://x.org/live.m3u8", CAP_PROP_FRAME_COUNT=-2e14).is_live
    assert not opened("https://x.org/film.m3u8", CAP_PROP_FRAME_COUNT=100.0).is_live


def test_passwords_are_in_no_name_and_no_message() -> None:
    address = "rtsp://me:s%3Acret@10.0.0.2:554/stream?channel=1"
    assert opened(address).name == "rtsp://me:…@10.0.0.2:554/stream?channel=1"
    with pytest.raises(VideoError) as caught:
        web_video(address, opener=lambda _: FakeCapture(opened=False))
    assert "cret" not in str(caught.value)
    for harmless in ("rtsp://me@10.0.0.2/a", "http://10.0.0.2:80/a:b@c"):
        assert without_password(harmless) == harmless
