"""Settings of the page: on this machine alone by default, and the results that it opens with."""

import importlib.util
import logging
import socket
from pathlib import Path

import pytest

from hand_recon.page.bounds import Bounds
from hand_recon.page.server import listening, page_settings, results_file, shown_address
from hand_recon.page.start import demo
from tests.support.page_server import demo_config


def test_by_default_the_page_is_on_this_machine_alone(caplog: pytest.LogCaptureFixture) -> None:
    config = demo_config()
    settings = page_settings(config)
    assert config.host == "127.0.0.1"
    assert set(settings.names) == {"127.0.0.1", "localhost", "::1"}
    assert settings.bounds == Bounds()
    assert not caplog.records


def test_another_address_is_warned_about_and_further_names_are_taken(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        settings = page_settings(demo_config("host=0.0.0.0", "names=[workstation]"))
    assert {"0.0.0.0", "workstation", "localhost"} <= set(settings.names)  # noqa: S104
    assert "everybody in this network" in caplog.text


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("127.0.0.1", "http://127.0.0.1:8765/"),
        ("0.0.0.0", "http://127.0.0.1:8765/"),  # noqa: S104
        ("::", "http://[::1]:8765/"),
        ("workstation", "http://workstation:8765/"),
    ],
)
def test_the_address_that_is_told_can_be_opened_with_a_camera(host: str, address: str) -> None:
    assert shown_address(host, 8765) == address


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("port=0", "port is 0; expected a number from 1 to 65535"),
        ("bounds.megabytes=0", "bounds.megabytes=0, .*expected numbers above 0"),
        ("bounds.seconds=-1", "bounds.seconds=-1"),
        ("bounds.waiting=-1", "bounds.waiting=-1"),
    ],
)
def test_settings_that_mean_nothing_are_refused(override: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        page_settings(demo_config(override))


@pytest.mark.parametrize("name", ["hands.json", "hands.jsonl"])
def test_the_file_of_hands_of_a_folder_is_found(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("[]")
    (tmp_path / "video.webm").write_bytes(b"")
    assert results_file(tmp_path) == results_file(tmp_path / name) == tmp_path / name
    settings = page_settings(demo_config(f"results='{tmp_path}'"))
    assert (settings.hands_file, settings.video) == (tmp_path / name, tmp_path / "video.webm")


def test_a_folder_without_hands_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No file of hands at .*expected hands\.json or"):
        results_file(tmp_path)


def test_without_the_extra_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "uvicorn" else known(name)
    )
    with pytest.raises(
        ModuleNotFoundError, match=r"needs uvicorn, which is not.*hand_recon\[demo\]"
    ):
        demo(demo_config())


def test_a_port_that_is_taken_is_refused_before_anything_is_loaded() -> None:
    with listening("127.0.0.1", 0) as other:
        port = other.getsockname()[1]
        with pytest.raises(
            ValueError, match=rf"port {port} cannot be used .*add port={port + 1}\."
        ):
            demo(demo_config(f"port={port}"))
    with listening("127.0.0.1", port) as again, socket.create_connection(again.getsockname()):
        pass
