"""The models' folder and the files they are found in: digests, damage, archives of every kind."""

import hashlib
import logging
import zipfile
from pathlib import Path

import pytest

from hand_recon.detection import model_files, models
from hand_recon.detection.model_download import prepare_models
from hand_recon.detection.model_files import models_in, models_in_content
from hand_recon.detection.models import (
    LANDMARKS,
    PALMS,
    ModelFolder,
    ModelsError,
    cache_folder,
)
from tests.support.detector_models import made_up_models, zipped


@pytest.fixture
def contents(monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Made-up models by name."""
    return made_up_models(monkeypatch)


def folder_with(path: Path, contents: dict[str, bytes]) -> ModelFolder:
    folder = ModelFolder(path)
    for name, content in contents.items():
        folder.write(name, content)
    return folder


def test_pins_are_whole_digests_of_two_different_files() -> None:
    assert {len(PALMS.sha256), len(LANDMARKS.sha256)} == {64}
    assert PALMS.sha256 != LANDMARKS.sha256


def test_the_published_models_match_their_pins(models: Path) -> None:
    content = (models / PALMS.file).read_bytes()
    assert PALMS.matches(content)
    assert not LANDMARKS.matches(content)
    assert not PALMS.matches(content[:-1] + b"x")


def test_the_folder_is_the_caches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HAND_RECON_CACHE", "/a/b")
    assert cache_folder() == Path("/a/b/detector")
    monkeypatch.delenv("HAND_RECON_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/c")
    assert cache_folder() == Path("/c/hand_recon/detector")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/me")
    assert ModelFolder().path == Path("/home/me/.cache/hand_recon/detector")


def test_what_is_written_is_read_and_nothing_else_is_left(
    contents: dict[str, bytes], tmp_path: Path
) -> None:
    folder = folder_with(tmp_path / "deep" / "cache", contents)
    assert [folder.read(model) for model in models.MODELS] == list(contents.values())
    assert folder.missing() == []
    assert sorted(path.name for path in folder.path.iterdir()) == sorted(contents)


def test_a_damaged_model_is_missing_and_said_to_be_replaced(
    contents: dict[str, bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = folder_with(tmp_path, contents)
    (tmp_path / "palms.tflite").write_bytes(contents["palms.tflite"][:-7])
    assert [model.file for model in folder.missing()] == ["palms.tflite"]
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "palms.tflite is not the published file" in record.getMessage()


def test_a_failed_write_leaves_the_old_file(
    contents: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = folder_with(tmp_path, contents)

    def full(self: Path, target: Path) -> Path:
        raise OSError("No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        folder.write("palms.tflite", b"new")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(contents)
    assert folder.missing() == []


def test_the_official_bundle_serves_whatever_models_it_holds(
    contents: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = {f"bundled_{name}": b"another version" + content for name, content in contents.items()}
    bundle = zipped(others, zipfile.ZIP_STORED)
    monkeypatch.setattr(models, "BUNDLE_SIZE", len(bundle))
    monkeypatch.setattr(models, "BUNDLE_SHA256", hashlib.sha256(bundle).hexdigest())
    assert models_in_content(bundle, "hand_landmarker.task") == {"hand_landmarker.task": bundle}
    folder = folder_with(tmp_path, {"hand_landmarker.task": bundle})
    assert [folder.read(model) for model in models.MODELS] == list(others.values())
    # The same file changed by one byte serves nothing.
    folder.write("hand_landmarker.task", bundle[:-1] + b"x")
    assert len(folder.missing()) == 2


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("prefix", ["", "mediapipe/modules/", "../../", "/etc/", "C:\\"])
def test_models_are_found_in_an_archive_under_any_name(
    contents: dict[str, bytes], tmp_path: Path, prefix: str, method: int
) -> None:
    members = {f"{prefix}{index}": content for index, content in enumerate(contents.values())}
    archive = tmp_path / "inside" / "archive.whl"
    archive.parent.mkdir()
    archive.write_bytes(zipped({"other": b"text", **members}, method))
    assert models_in([archive]) == contents
    # Nothing is unpacked, whatever path a member names.
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [archive]


def test_models_are_found_as_files_and_in_folders(
    contents: dict[str, bytes], tmp_path: Path
) -> None:
    (tmp_path / "a").mkdir()
    for name, content in contents.items():
        (tmp_path / "a" / name).write_bytes(content)
    (tmp_path / "a" / "other.tflite").write_bytes(b"another network")
    assert models_in([tmp_path]) == contents
    assert models_in([tmp_path / "a" / "palms.tflite"]) == {
        "palms.tflite": contents["palms.tflite"]
    }


def test_a_model_of_the_right_size_and_wrong_content_is_not_taken(
    contents: dict[str, bytes],
) -> None:
    forged = {name: b"x" * len(content) for name, content in contents.items()}
    assert models_in_content(zipped(forged), "forged.zip") == {}
    assert models_in_content(forged["palms.tflite"], "palms.tflite") == {}


def test_an_archive_that_inflates_is_never_inflated(
    contents: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A hundred megabytes of zeros in a hundred kilobytes: of no model's size, so it is not opened.
    bomb = zipped({"palms.tflite": bytes(100_000_000)})
    assert len(bomb) < 200_000

    def opened(*_: object) -> None:
        raise AssertionError("a member was opened")

    monkeypatch.setattr(zipfile.ZipFile, "open", opened)
    assert models_in_content(bomb, "bomb.zip") == {}


def test_a_member_that_lies_about_its_size_is_refused(contents: dict[str, bytes]) -> None:
    size = len(contents["palms.tflite"])
    honest = zipped({"palms.tflite": bytes(50_000_000)})
    lying = honest.replace((50_000_000).to_bytes(4, "little"), size.to_bytes(4, "little"))
    assert lying != honest
    with pytest.raises(ModelsError, match=r"liar.zip is a damaged zip file"):
        models_in_content(lying, "liar.zip")


def test_a_truncated_archive_is_refused_or_holds_nothing(contents: dict[str, bytes]) -> None:
    whole = zipped(contents, zipfile.ZIP_STORED)
    assert models_in_content(whole, "whole.zip") == contents
    # Without its end it is no zip file; with one byte of a model changed, its checksum fails.
    assert models_in_content(whole[: len(whole) // 2], "half.zip") == {}
    with pytest.raises(ModelsError, match=r"damaged zip file .*Download it again"):
        models_in_content(whole.replace(b"palmspalms", b"palmsPalms", 1), "changed.zip")


def test_an_encrypted_archive_is_refused(contents: dict[str, bytes]) -> None:
    plain = bytearray(zipped(contents, zipfile.ZIP_STORED))
    # The flag of encryption, in the local header and in the directory of the archive.
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = plain.find(mark)
        while place >= 0:
            plain[place + offset] |= 1
            place = plain.find(mark, place + 1)
    with pytest.raises(ModelsError, match=r"locked.zip is a damaged zip file .*encrypted"):
        models_in_content(bytes(plain), "locked.zip")


def test_a_missing_and_a_giant_file_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ModelsError, match=r"No file .*none.task. Name MediaPipe's"):
        models_in([tmp_path / "none.task"])
    monkeypatch.setattr(model_files, "LARGEST", 10)
    (tmp_path / "large.zip").write_bytes(b"x" * 11)
    with pytest.raises(ModelsError, match=r"large.zip has 11 bytes, more than 10"):
        models_in([tmp_path / "large.zip"])


def test_a_cache_that_cannot_be_made_is_said_before_anything_is_fetched(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(ModelsError, match=r"file/detector .* cannot be made .*HAND_RECON_CACHE"):
        prepare_models(
            [], ModelFolder(tmp_path / "file" / "detector"), address="http://127.0.0.1:9"
        )
