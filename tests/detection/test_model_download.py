"""Fetching the models: from an address on this machine, and by package clients that only pretend."""

import hashlib
import importlib.util
import logging
import os
import shutil
import stat
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from hand_recon.detection import model_download, models
from hand_recon.detection.model_download import (
    available_clients,
    from_address,
    from_pip,
    from_uv,
    model_loader,
    prepare_models,
)
from hand_recon.detection.models import ModelFolder, ModelsError
from tests.support.detector_models import made_up_models, zipped

Serve = Callable[..., str]

NOWHERE = "http://127.0.0.1:9/hand_landmarker.task"
"""An address at which nothing answers."""


@pytest.fixture
def contents(monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Made-up models by name."""
    return made_up_models(monkeypatch)


@pytest.fixture
def serve() -> Iterator[Serve]:
    """A function that serves some bytes on the loopback interface and returns their address."""
    servers: list[HTTPServer] = []

    def start(content: bytes, status: int = 200, declared: int | None = None) -> str:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(status)
                self.send_header("Content-Length", str(declared or len(content)))
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *_: object) -> None:
                """Print nothing."""

        server = HTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/hand_landmarker.task"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture
def no_clients(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without package clients."""
    monkeypatch.setattr(model_download, "available_clients", list)


def test_the_bundle_is_fetched_once_and_aloud(
    contents: dict[str, bytes],
    serve: Serve,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    folder = ModelFolder(tmp_path)
    written = prepare_models((), folder, address=serve(zipped(contents)))
    assert sorted(path.name for path in written) == sorted(contents)
    assert folder.missing() == []
    assert "Fetching MediaPipe's two networks of hands" in caplog.text
    caplog.clear()
    assert prepare_models((), folder, address=NOWHERE) == []
    assert caplog.text == ""


def test_a_detector_fetches_what_it_needs_and_mends_what_is_damaged(
    contents: dict[str, bytes],
    serve: Serve,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    prepare = prepare_models
    address = serve(zipped(contents))
    monkeypatch.setattr(
        model_download,
        "prepare_models",
        lambda files, folder: prepare(files, folder, address=address),
    )
    load = model_loader(models.MODELS[0], tmp_path)
    assert not list(tmp_path.iterdir())
    assert load() == contents["palms.tflite"]
    (tmp_path / "palms.tflite").write_bytes(b"half")
    assert load() == contents["palms.tflite"]
    assert "palms.tflite is not the published file" in caplog.text


@pytest.mark.parametrize("status", [403, 404, 500])
def test_an_answer_that_is_an_error_is_told(serve: Serve, status: int) -> None:
    with pytest.raises(ModelsError, match=r"127.0.0.1.* cannot be had"):
        from_address(serve(b"sorry", status))


@pytest.mark.usefixtures("contents")
def test_another_file_at_the_address_is_told(serve: Serve) -> None:
    with pytest.raises(ModelsError, match=r"gave 12 bytes that are not the published bundle"):
        from_address(serve(b"<html></html"))


def test_a_download_that_breaks_off_is_not_taken(contents: dict[str, bytes], serve: Serve) -> None:
    whole = zipped(contents, zipfile.ZIP_STORED)
    with pytest.raises(ModelsError, match=r"cannot be had|not the published bundle"):
        from_address(serve(whole[:-100], declared=len(whole)))


@pytest.mark.usefixtures("contents")
def test_no_more_is_read_than_the_bundle_can_have(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_download, "BUNDLE_SIZE", 1000)
    with pytest.raises(ModelsError, match="gave 1001 bytes"):
        from_address(serve(bytes(3_000_000)))


@pytest.mark.usefixtures("contents", "no_clients")
def test_without_network_the_error_says_what_to_fetch_and_to_type(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ModelsError) as refused:
        prepare_models((), ModelFolder(tmp_path), address=NOWHERE)
    text = str(refused.value)
    assert f"download {NOWHERE}" in text
    assert "pip download" in text
    assert "mediapipe==0.10.21" in text
    assert "hand-recon prepare detector <file>" in text
    assert "refused" in text
    assert not list(tmp_path.iterdir())


def test_named_files_are_enough_without_network(contents: dict[str, bytes], tmp_path: Path) -> None:
    (tmp_path / "mine.zip").write_bytes(zipped(contents))
    folder = ModelFolder(tmp_path / "cache")
    assert len(prepare_models([tmp_path / "mine.zip"], folder, address=NOWHERE)) == 2
    assert folder.missing() == []


def test_two_files_may_come_one_after_the_other(contents: dict[str, bytes], tmp_path: Path) -> None:
    files = [tmp_path / name for name in contents]
    for file in files:
        file.write_bytes(contents[file.name])
    folder = ModelFolder(tmp_path / "cache")
    with pytest.raises(ModelsError, match=r"palms.tflite: landmarks.tflite is not in it. What was"):
        prepare_models(files[:1], folder)
    assert prepare_models(files[1:], folder) == [tmp_path / "cache" / "landmarks.tflite"]
    assert folder.missing() == []
    together = ModelFolder(tmp_path / "together")
    assert len(prepare_models(files, together)) == 2


@pytest.mark.usefixtures("contents")
def test_a_file_without_models_changes_nothing(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no model")
    with pytest.raises(ModelsError, match=r"notes.txt: none of the models is in it. Expected"):
        prepare_models([tmp_path / "notes.txt"], ModelFolder(tmp_path / "cache"))
    assert not (tmp_path / "cache").exists()


def pretend(folder: Path, name: str, script: str) -> Path:
    """A program that a test puts on the PATH: Python code with `words`, its arguments."""
    folder.mkdir(exist_ok=True)
    program = folder / name
    program.write_text(f"#!{sys.executable}\nimport pathlib, sys\nwords = sys.argv[1:]\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


UNPACK = """
(target,) = [word.split("=", 1)[1] for word in words if word.startswith("--target=")]
place = pathlib.Path(target) / "mediapipe" / "modules"
place.mkdir(parents=True)
source = pathlib.Path({source!r})
for model in source.iterdir():
    (place / model.name).write_bytes(model.read_bytes())
(requirements,) = [word.split("=", 1)[1] for word in words if word.startswith("--requirement=")]
pathlib.Path({log!r}).write_text(" ".join(words) + chr(10) + pathlib.Path(requirements).read_text())
"""

DOWNLOAD = """
import shutil
(target,) = [word.split("=", 1)[1] for word in words if word.startswith("--dest=")]
pathlib.Path(target).mkdir()
shutil.copy({source!r}, pathlib.Path(target) / "mediapipe.whl")
(requirements,) = [word.split("=", 1)[1] for word in words if word.startswith("--requirement=")]
pathlib.Path({log!r}).write_text(" ".join(words) + chr(10) + pathlib.Path(requirements).read_text())
"""


@pytest.fixture
def only_uv(contents: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine that has uv and no pip; the file that its pretended uv writes its words to."""
    source = tmp_path / "source"
    source.mkdir()
    for name, content in contents.items():
        (source / name).write_bytes(content)
    log = tmp_path / "words.txt"
    pretend(tmp_path / "bin", "uv", UNPACK.format(source=str(source), log=str(log)))
    monkeypatch.setattr(
        model_download, "_uv", lambda: shutil.which("uv", path=str(tmp_path / "bin"))
    )
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    return log


def test_uv_alone_is_enough(only_uv: Path, contents: dict[str, bytes], tmp_path: Path) -> None:
    assert available_clients() == [from_uv]
    folder = ModelFolder(tmp_path / "cache")
    assert len(prepare_models((), folder, address=NOWHERE)) == 2
    assert folder.missing() == []
    words = only_uv.read_text()
    assert words.startswith("pip install ")
    # Nothing is installed into this environment, and the wheel is pinned.
    for expected in ("--target=", "--no-deps", "--only-binary=:all:", "--require-hashes"):
        assert expected in words
    assert f"mediapipe==0.10.21 --hash=sha256:{model_download.WHEEL_SHA256}" in words


def test_pip_alone_is_enough(
    contents: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "source.whl").write_bytes(zipped({"mediapipe/a.py": b"", **contents}))
    log = tmp_path / "words.txt"
    python = pretend(
        tmp_path / "bin",
        "python",
        DOWNLOAD.format(source=str(tmp_path / "source.whl"), log=str(log)),
    )
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(model_download, "_uv", lambda: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == "pip" or None)
    assert available_clients() == [from_pip]
    folder = ModelFolder(tmp_path / "cache")
    assert len(prepare_models((), folder, address=NOWHERE)) == 2
    assert (words := log.read_text()).startswith("-m pip download ")
    assert "--require-hashes" in words
    assert "--platform=manylinux_2_28_x86_64" in words


def test_a_client_that_fails_is_told_with_its_last_words_and_the_next_is_tried(
    only_uv: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    python = pretend(
        tmp_path / "bin", "python", "print('one', file=sys.stderr)\nsys.exit('no matching wheel')"
    )
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(model_download, "available_clients", lambda: [from_pip, from_uv])
    assert len(prepare_models((), ModelFolder(tmp_path / "cache"), address=NOWHERE)) == 2
    assert "pip cannot fetch mediapipe==0.10.21 (no matching wheel)." in caplog.text
    assert only_uv.is_file()


@pytest.mark.usefixtures("only_uv")
def test_a_package_without_the_models_is_told(tmp_path: Path) -> None:
    (tmp_path / "source" / "palms.tflite").write_bytes(b"another")
    with pytest.raises(ModelsError, match="that uv fetched does not hold the two models"):
        from_uv()


def test_a_client_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", os.devnull)
    with pytest.raises(ModelsError, match=r"pip cannot fetch mediapipe==0.10.21 \("):
        from_pip()


def test_pins_of_wheel_and_address_are_the_published_ones() -> None:
    assert len(model_download.WHEEL_SHA256) == len(models.BUNDLE_SHA256) == 64
    assert model_download.ADDRESS.startswith("https://")
    assert hashlib.sha256(b"").hexdigest() not in (
        model_download.WHEEL_SHA256,
        models.BUNDLE_SHA256,
    )
