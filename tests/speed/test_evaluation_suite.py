import json
import sys
from pathlib import Path

import numpy as np
import pytest

from hand_recon.protocols.prediction_files import read_pair
from hand_recon.speed.measurement import Settings
from hand_recon.speed.suites import evaluation
from hand_recon.speed.suites.evaluation import HO3D, ScoredSet, posed_hands, write_files


@pytest.mark.slow
def test_scores_are_the_scripts_and_the_command_scores_the_files(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(evaluation, "COMPARED", 1)
    monkeypatch.setattr(evaluation, "FREIHAND", ScoredSet(evaluation.FREIHAND.protocol, 4, 5.0))
    compared, command = evaluation.measure(Settings(seconds=0.0, quick=True))
    assert float(compared.difference.split()[0]) < 1e-4
    assert compared.ratio is not None
    assert command.seconds.median > 0
    assert command.megabytes is not None
    assert command.megabytes > 50


def test_files_repeat_the_hands_in_the_benchmarks_conventions(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(evaluation, "DISTINCT", 2)
    write_files(tmp_path, ScoredSet(HO3D.protocol, 5, 1.0))
    pair = read_pair(tmp_path / "pred.json", tmp_path, HO3D.protocol)
    _, expected = posed_hands(2)
    found = HO3D.protocol.to_internal(pair.prediction)
    assert len(found) == 5
    np.testing.assert_allclose(found.landmarks[2:4], expected.landmarks, atol=1e-4)
    assert found.vertices is not None
    assert expected.vertices is not None
    np.testing.assert_allclose(found.vertices[4], expected.vertices[0], atol=1e-4)
    # HO3D's camera looks along −z.
    assert np.array(json.loads((tmp_path / "evaluation_xyz.json").read_text()))[..., 2].max() < 0


def test_a_command_that_fails_says_why() -> None:
    with pytest.raises(
        RuntimeError, match=r"exit\('no file'\) failed, expected were scores: no file"
    ):
        evaluation._run([sys.executable, "-c", "import sys; sys.exit('no file')"], Settings())
