"""The report opens without a network and shows its content."""

import re
from pathlib import Path

import cv2
import numpy as np

from hand_recon.visualization.curves import draw_curves, read_log
from hand_recon.visualization.run_report import Report, write_report


def test_the_page_embeds_its_images_and_needs_no_network(tmp_path: Path) -> None:
    image = tmp_path / "a.png"
    cv2.imwrite(str(image), np.zeros((4, 4, 3), dtype=np.uint8))
    report = Report(
        title="Ours <on> synthetic", scores={"E_J": 12.345, "other": 1.0}, baseline={"E_J": 17.0},
        facts={"epochs": 3}, overlays=(image,), curves=image, config="a: 1",
    )  # fmt: skip
    write_report(report, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "12.345" in page
    assert "17.000" in page
    assert "Ours &lt;on&gt; synthetic" in page
    assert page.count("data:image/png;base64,") == 2
    assert not re.search(r"(src|href)=\"(?!data:)", page)


def test_further_figures_are_shown_with_their_captions(tmp_path: Path) -> None:
    image = tmp_path / "a.png"
    cv2.imwrite(str(image), np.zeros((4, 4, 3), dtype=np.uint8))
    report = Report(
        title="t", scores={"PR": 1.5}, baseline={}, facts={}, overlays=(), curves=None, config="",
        figures=(("Where it is <unsure>", image), ("And where not", image)),
    )  # fmt: skip
    write_report(report, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert page.index("<figcaption>Where it is &lt;unsure&gt;") < page.index("And where not")
    assert "penetrate" in page


def test_curves_are_drawn_from_lightnings_log(tmp_path: Path) -> None:
    log = tmp_path / "metrics.csv"
    log.write_text(
        "epoch,step,train/loss,val/loss,val/E_J,train/weighted/shape\n"
        "0,9,30.0,,,2.0\n0,9,,28.0,15.0,\n1,19,20.0,,,1.0\n1,19,,19.0,12.0,\n"
    )
    assert read_log(log)["val/E_J"] == [(0.0, 15.0), (1.0, 12.0)]
    drawn = draw_curves(log, tmp_path / "curves.png")
    assert set(drawn) == {"train/loss", "val/loss", "val/E_J", "train/weighted/shape"}
    image = cv2.imread(str(tmp_path / "curves.png"))
    assert image is not None
    assert image.std() > 5
