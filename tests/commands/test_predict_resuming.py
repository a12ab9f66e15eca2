"""`predict` that was interrupted goes on in its folder, and loses and doubles nothing."""

import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from hand_recon.runs import looking, predict_run
from hand_recon.runs.predict_run import predict
from tests.support.photo_folder import asked, table


def test_an_interrupted_command_goes_on_where_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    monkeypatch.setattr(predict_run, "PHOTOS_AT_ONCE", 1)
    predict(asked(folder, f"output='{folder}/whole'"))
    expected = (folder / "whole" / "hands.json").read_bytes()
    real = looking.look_at_file
    looks = itertools.count()

    def interrupted(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        if next(looks) == 2:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(predict_run, "look_at_file", interrupted)
    with pytest.raises(KeyboardInterrupt):
        predict(asked(folder))
    out = folder / "out"
    assert len(json.loads((out / "hands.json.part").read_text(encoding="utf-8"))) == 2
    assert not (out / "hands.json").exists()
    # A kill may leave half a line of either file.
    for name in ("hands.json.part", "progress.jsonl"):
        with (out / name).open("a", encoding="utf-8") as stream:
            stream.write('{"image": "3')
    with pytest.raises(FileExistsError, match="unfinished results of a command with other options"):
        predict(asked(folder, "descent.steps=21"))
    assert predict(asked(folder))["hands"] == 3
    # Two photographs were not looked at again, and nothing is there twice.
    assert next(looks) == 4
    assert (out / "hands.json").read_bytes() == expected
    assert [row["image"] for row in table(out / "images.csv")] == sorted(
        path.name for path in (folder / "photos").iterdir()
    )


def test_a_second_interruption_loses_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    monkeypatch.setattr(predict_run, "PHOTOS_AT_ONCE", 1)
    predict(asked(folder, f"output='{folder}/whole'"))
    real, stop = looking.look_at_file, {0, 1, 3}
    looks = itertools.count()

    def interrupted(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        if next(looks) in stop:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(predict_run, "look_at_file", interrupted)
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            predict(asked(folder))
    # Hands without their row, and rows without all of their hands, are done again.
    out = folder / "out"
    lines = (out / "hands.json.part").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 4
    (out / "hands.json.part").write_text("\n".join(lines[:2]), encoding="utf-8")
    assert predict(asked(folder))["hands"] == 3
    assert (out / "hands.json").read_bytes() == (folder / "whole" / "hands.json").read_bytes()
    assert not list(out.glob("*.new"))


def test_another_camera_file_does_not_go_on_with_the_results_of_the_first(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    monkeypatch.setattr(
        predict_run, "look_at_file", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt)
    )
    with pytest.raises(KeyboardInterrupt):
        predict(asked(folder))
    (folder / "K.json").write_text(json.dumps([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]))
    with pytest.raises(FileExistsError, match="unfinished results of a command with other files"):
        predict(asked(folder))
