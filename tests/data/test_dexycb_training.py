"""A folder in DexYCB's layout trains and is evaluated, with the open hand and with MANO."""

from pathlib import Path

import pytest

from hand_recon.data.dexycb.surfaces import load_pair
from hand_recon.rehearsal.dexycb import DexYcbFolder, write_dexycb_layout
from hand_recon.runs.evaluation_run import evaluate
from hand_recon.runs.training_run import train
from tests.support.configurations import settings
from tests.support.mano_file import write_mano_folder
from tests.support.small_runs import LIGHTNING_WARNINGS

pytestmark = LIGHTNING_WARNINGS

SMALL = (
    "data=dexycb", "data.partial=true", "data.batch_size=8", "data.label_workers=0",
    "data.reading.workers=1", "model.encoder.backbone=mobilenet_v3_small", "model.width=32",
    "trainer.max_epochs=1", "+trainer.limit_train_batches=2", "trainer.accelerator=cpu", "threads=1",
    "report.images=2", "crop_size=48",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("hand", ["open", "mano"])
def test_a_dexycb_folder_trains_and_is_evaluated(hand: str, tmp_path: Path) -> None:
    mano = write_mano_folder(tmp_path / "mano")
    root = tmp_path / "dex-ycb"
    pair = load_pair(mano, left_hands=True)
    write_dexycb_layout(root, DexYcbFolder(subjects=(0, 2), every=19, mano=pair))
    chosen = [
        *SMALL,
        f"data.root={root}",
        f"data.mano={mano}",
        f"hand={hand}",
    ]
    if hand == "mano":
        chosen.append(f"hand.path={mano}")
    metrics = train(settings(tmp_path / "cache", tmp_path / "run", *chosen))
    assert {"E_J", "MPJPE", "E_2D"} <= set(metrics["test"])
    assert ({"E_V", "E_RV", "F@5"} <= set(metrics["test"])) == (hand == "mano")
    ckpt = [f"ckpt={tmp_path / 'run'}", "threads=1"]
    again = evaluate(settings(tmp_path / "cache", tmp_path / "again", *ckpt, name="evaluate"))
    assert again["landmarks"] == "dexycb"
    assert again["test"] == pytest.approx(metrics["test"], rel=1e-6)
