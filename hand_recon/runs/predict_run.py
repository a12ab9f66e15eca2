"""Finds the hands of photographs and reconstructs them: detector, fit, results (Sec. 3.2-3.4)."""

import logging
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig, OmegaConf

from hand_recon.data.photos.listing import photo_files
from hand_recon.data.progress import with_progress
from hand_recon.data.video.frames import FrameSource
from hand_recon.data.video.words import frame_source, video_kind
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.hands_file import hand_entries
from hand_recon.fitting.hands_list import writing_list
from hand_recon.fitting.in_parts import PART, fit_part
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.runs.clip.clip_run import predict_clip
from hand_recon.runs.clip.live_run import predict_live
from hand_recon.runs.configuration import build_hand, configure_process, instantiate, plain
from hand_recon.runs.fit_run import adapted_to_data, refuse_doubts, source_of
from hand_recon.runs.fitters import build_fitter, fitter_of
from hand_recon.runs.looking import (
    LookedAt,
    build_detector,
    look_at_file,
    photo_names,
    steps_before,
    to_landmarks,
)
from hand_recon.runs.photo_checkpoint import checkpoint_file, with_network
from hand_recon.runs.photo_network import PhotoNetwork
from hand_recon.runs.photo_results import PHOTO_PRODUCTS, PhotoResults
from hand_recon.runs.ranking_file import check_ranking
from hand_recon.runs.unfinished import (
    MARK,
    claim_or_resume,
    file_state,
    finish,
    results_folder,
    settings_of,
)

logger = logging.getLogger(__name__)

PHOTOS_AT_ONCE: Final = 32
"""Most photographs whose hands are fitted in one batch."""

_FILES: Final = ("camera", "detector.landmarks", "detector.boxes", "lifter", "hand.path")


def predict(config: DictConfig) -> dict[str, Any]:
    """Reconstruct the hands of photographs.

    Args:
        config: `conf/predict.yaml` composed.

    Returns:
        Numbers of images, hands, doubtful hands and images that could not be processed.

    Raises:
        ValueError: There is no photograph; a photograph could not be read, no hand was fitted, or strict is
            set and a hand is doubtful. Results of everything else are written then.
    """
    configure_process(config.threads)
    config = adapted_to_data(config)
    inputs = _inputs(config)
    video = _video(inputs, config.motion.fps)
    check_ranking(
        config.rank,
        folder=config.json != "-" or config.output is not None,
        photographs=video is None,
    )
    if video is not None:
        with video:
            return _predict_video(config, video, inputs[0])
    files = _without_results(photo_files(inputs), config.output)
    if not files:
        raise ValueError(
            f"No image in {', '.join(inputs)}; expected photographs, or folders of them."
        )
    if config.json not in (None, "-"):
        raise ValueError(
            f"json={config.json} is not supported; json=- writes the hands to standard output, and "
            "output=<folder> writes hands.json there."
        )
    config, network = with_network(config)
    stages = _Stages(config, files, network)
    if config.json == "-" and config.output is None:
        summary = _to_stream(stages)
    else:
        summary = _to_folder(stages, config)
    _check(summary, strict=config.strict)
    return summary


def _predict_video(config: DictConfig, video: FrameSource, word: str) -> dict[str, Any]:
    """Reconstruct the hands of a video or a camera; with strict, none of those that were seen is doubtful."""
    found = predict_live(config, video) if video.is_live else predict_clip(config, video, word)
    if config.strict:
        refuse_doubts(found)
    return found


def _inputs(config: DictConfig) -> list[str]:
    given = None if OmegaConf.is_missing(config, "input") else config.input
    names = [given] if isinstance(given, str) else [str(one) for one in given or ()]
    if not names or not all(names):
        raise ValueError(
            "No image is named. Give photographs or folders of them: hand-recon predict photo.jpg my_photos."
        )
    return names


def _video(inputs: Sequence[str], fps: float | None) -> FrameSource | None:
    """The video that the inputs name; None for photographs.

    Raises:
        ValueError: There is something else beside a video.
    """
    videos = [word for word in inputs if video_kind(word, fps) is not None]
    if not videos:
        return None
    if len(inputs) > 1:
        raise ValueError(
            f"Found the video {videos[0]} and {len(inputs) - 1} more input(s); expected one video alone, or "
            "photographs. Run the command for each video."
        )
    return frame_source(videos[0], fps)


def _without_results(files: Sequence[Path], output: str | None) -> list[Path]:
    """Leave out what this program drew: files in the output folder, and in `overlays` of results."""
    own = None if not output else Path(output).expanduser().absolute()

    def is_result(file: Path) -> bool:
        folders = file.absolute().parents
        drawn = any(
            folder.name == "overlays"
            and any((folder.parent / name).exists() for name in ("hands.json", MARK))
            for folder in folders
        )
        return drawn or own in folders

    kept = [file for file in files if not is_result(file)]
    if len(kept) < len(files):
        logger.info("%d images are results of this program and left out.", len(files) - len(kept))
    return kept


class _Stages:
    """The detector and the fit of a command, and the photographs that they are run on."""

    def __init__(
        self, config: DictConfig, files: Sequence[Path], network: PhotoNetwork | None
    ) -> None:
        self.config, self.network = config, network
        self.files = list(files)
        # Names that are not UTF-8 could not be written.
        self.names = [
            os.fsencode(name).decode("utf-8", "backslashreplace") for name in photo_names(files)
        ]
        self.camera = parse_camera(str(config.camera), len(files))
        self.detector = build_detector(config)
        self.hand = build_hand(config)
        self.fitter = build_fitter(config, self.hand)
        self.origin = source_of(config, self.hand, steps_before(self.detector, network))

    def looked_at(self, done: frozenset[str] = frozenset()) -> Iterator[LookedAt]:
        """Find the hands of each photograph that is not done yet."""
        numbered = [one for one in enumerate(self.files) if self.names[one[0]] not in done]
        task = f"Reconstructing the hands of {len(numbered)} images"
        for number, path in with_progress(numbered, len(numbered), task):
            yield look_at_file(
                number, self.names[number], path, self.detector, self.camera, network=self.network
            )

    def fitted(
        self, done: frozenset[str] = frozenset()
    ) -> Iterator[tuple[list[LookedAt], FittedHands | None]]:
        """Find and fit the hands, some photographs at a time; None for a batch without hands."""
        fitter, looked = self.fitter, self.looked_at(done)
        if self.config.same_person:
            # Also of photographs that are done: a person's shape is that of all hands.
            everything = list(self.looked_at())
            landmarks, _ = to_landmarks(everything, self.origin)
            fitter = fitter_of(self.config, self.hand, landmarks, fitter)
            looked = (one for one in everything if one.name not in done)
        for batch in _batches(looked):
            if not any(one.hands for one in batch):
                yield batch, None
                continue
            start = time.perf_counter()
            landmarks, origins = to_landmarks(batch, self.origin)
            part = fit_part(landmarks, fitter, origins)
            each = (time.perf_counter() - start) / len(part)
            yield [one.with_time("fit", each * len(one.hands)) for one in batch], part


def _batches(looked: Iterator[LookedAt]) -> Iterator[list[LookedAt]]:
    """Group photographs so that a batch has about `PART` hands."""
    batch: list[LookedAt] = []
    for one in looked:
        batch.append(one)
        if len(batch) == PHOTOS_AT_ONCE or sum(len(each.hands) for each in batch) >= PART:
            yield batch
            batch = []
    if batch:
        yield batch


def _to_stream(stages: _Stages) -> dict[str, Any]:
    """Write the hands to standard output as a JSON list, a hand to a line."""
    summary = Counter(images=0, failed=0, hands=0, fitted=0, doubtful=0)
    with writing_list(sys.stdout) as write:
        for batch, part in stages.fitted():
            summary.update(images=len(batch), failed=sum(one.error is not None for one in batch))
            if part is not None:
                records = to_records(part)
                summary.update(records.counts())
                write(hand_entries(records))
    return dict(summary)


def _to_folder(stages: _Stages, config: DictConfig) -> dict[str, Any]:
    """Write the hands and pictures of them to a folder, or go on in one that an interrupted run left."""
    folder = results_folder(config)
    settings = settings_of(config, _FILES)
    settings["images"] = [file_state(path) for path in stages.files]
    if config.ckpt is not None:
        # Of a run's folder, whose own state does not tell whether the checkpoint changed.
        settings["files"]["ckpt"] = file_state(checkpoint_file(config.ckpt))
    options = instantiate(config.results)
    goes_on = claim_or_resume(folder, (*PHOTO_PRODUCTS, "config.yaml"), settings)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    logger.info("Reconstructing the hands of %d images into %s", len(stages.files), folder)
    results = PhotoResults(folder, stages.hand.faces.numpy(), options)
    with results.writing(goes_on=goes_on) as done:
        for batch, part in stages.fitted(frozenset(done)):
            results.add(batch, part)
    if config.json == "-":
        sys.stdout.write((folder / "hands.json").read_text(encoding="utf-8"))
    finish(folder)
    return results.summary


def _check(summary: dict[str, Any], *, strict: bool) -> None:
    """Check that everything was processed, which is what status 0 stands for."""
    images = summary["images"]
    if summary["failed"]:
        raise ValueError(
            f"{summary['failed']} of {images} images could not be processed, for the reasons above; the "
            "hands of the others are written."
        )
    if not summary["fitted"]:
        raise ValueError(
            f"No hand was fitted in {images} image(s). A hand that is there may be too small, cut off or "
            "blurred; detector.min_palm_score=0.3 looks less strictly, and detector=whole takes each image "
            "for one hand."
        )
    if strict:
        refuse_doubts(summary)
