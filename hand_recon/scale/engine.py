"""`hand-recon predict engine=daft`: images in parts, by workers of Daft or Ray (docs/scale.md)."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig, OmegaConf

from hand_recon.data.progress import with_progress
from hand_recon.runs.configuration import configure_process, plain
from hand_recon.runs.fit_run import adapted_to_data, refuse_doubts
from hand_recon.runs.photo_checkpoint import checkpoint_file
from hand_recon.runs.results import write_json
from hand_recon.runs.unfinished import (
    claim_or_resume,
    file_state,
    finish,
    results_folder,
    settings_of,
)
from hand_recon.scale.extra import arrow_module, check_ray, daft_module
from hand_recon.scale.image_worker import ImageWorker
from hand_recon.scale.isolation import NOT_OF_A_ROW
from hand_recon.scale.parts import MANIFEST, PARTS, PartFiles
from hand_recon.scale.places import Places, places_of
from hand_recon.scale.settings import worker_settings
from hand_recon.scale.udfs import HandsOfPlaces, worker_column

logger = logging.getLogger(__name__)

ATTEMPTS: Final = 3
"""Times in a row that workers may fail without a new part."""

_RAISED: Final = "failed with traceback"
"""Words of Daft's error for a worker that raised one, which is none of an image: those are in their rows."""

_FILES: Final = ("camera", "detector.landmarks", "detector.boxes", "lifter", "hand.path")
_NO_RESULT: Final = ("workers", "ray", "engine", "input", "rank", "results", "motion")


def predict_in_parts(config: DictConfig) -> dict[str, Any]:
    """Reconstruct the hands of an input part by part, or go on in the folder of an interrupted command.

    Args:
        config: `conf/predict.yaml` composed, with `engine=daft`.

    Returns:
        Numbers of images, hands, doubtful hands and images that could not be processed.

    Raises:
        FileExistsError: The folder holds complete results, or unfinished ones of other settings or inputs.
        ChildProcessError: Workers fail again and again without a new part.
        OSError: A part cannot be written.
        ValueError: There is no image, a setting is not for parts, or strict is set and there are failures.
    """
    configure_process(config.threads)
    daft = _started(config)
    refuse_other_results(config)
    given = config.input
    folder = results_folder(config)
    places = places_of([given] if isinstance(given, str) else list(given), config.column, folder)
    worker = worker_settings(config)
    # What every worker would refuse is said here, once.
    ImageWorker(worker)
    parts = _claimed(config, folder, places)
    logger.info(
        "Reconstructing the hands of %d images into %s, %d of %d parts are there already.",
        len(places), folder, len(parts.done), parts.count,
    )  # fmt: skip
    run = _Run(daft, config, places, parts, worker)
    for _ in with_progress(run.written(), len(parts.missing()), f"Parts of {config.part} images"):
        pass
    summary = parts.summary()
    write_json(folder / MANIFEST, _manifest(config, places, parts, summary))
    finish(folder)
    _tell(summary, folder, strict=config.strict)
    return summary


def _started(config: DictConfig) -> Any:  # noqa: ANN401  # the module
    """Daft with its runner: processes of this machine, or those of a Ray cluster."""
    daft = daft_module()
    # Each step of Daft would be a line of the log.
    logging.getLogger("tracing.span").setLevel(logging.WARNING)
    if config.ray is None:
        return daft
    check_ray()
    # `auto` is a cluster that runs already, or a new one on this machine.
    daft.set_runner_ray(
        address=None if config.ray == "auto" else str(config.ray), noop_if_initialized=True
    )
    return daft


def refuse_other_results(config: DictConfig) -> None:
    """Check that nothing is asked for that needs all hands at once.

    Args:
        config: `conf/predict.yaml` composed.

    Raises:
        ValueError: Something is.
    """
    for key in ("json", "rank"):
        if config[key] is not None:
            raise ValueError(
                f"Found {key}={config[key]} beside engine=daft, which writes Parquet files alone. Leave it "
                "out, or run the command without engine=daft."
            )
    for key in ("workers", "batch", "part"):
        if config[key] < 1:
            raise ValueError(f"Found {key}={config[key]}; expected 1 or more.")


def _claimed(config: DictConfig, folder: Path, places: Places) -> PartFiles:
    settings = settings_of(adapted_to_data(config), _FILES)
    for key in _NO_RESULT:
        settings["options"].pop(key, None)
    settings["input"] = places.state()
    if config.ckpt is not None:
        settings["files"]["ckpt"] = file_state(checkpoint_file(config.ckpt))
    claim_or_resume(folder, (MANIFEST, "config.yaml", PARTS), settings)
    OmegaConf.save(OmegaConf.create(plain(adapted_to_data(config))), folder / "config.yaml")
    (folder / PARTS).mkdir(exist_ok=True)
    return PartFiles(folder / PARTS, len(places), config.part)


class _Run:
    """One command: queries over the parts that are missing, until none is."""

    def __init__(
        self,
        daft: Any,  # noqa: ANN401  # the module
        config: DictConfig,
        places: Places,
        parts: PartFiles,
        settings: dict[str, Any],
    ) -> None:
        self.daft, self.config, self.places, self.parts = daft, config, places, parts
        self.settings = settings
        self.error: Exception | None = None

    def written(self) -> Iterator[int]:
        """Yield each part when it is written; after a worker's death, the missing parts are run again.

        Raises:
            ChildProcessError: Workers fail again and again without a new part.
            OSError: A part cannot be written.
        """
        failures = 0
        while missing := self.parts.missing():
            self.error = None
            # Errors of writing end the command here: they are none of the workers'.
            for rows in self._of_workers(missing):
                yield from self.parts.add(rows)
            if self.error is not None:
                progress = len(self.parts.missing()) < len(missing)
                failures = 1 if progress else failures + 1
                self._tell_failure(self.error, failures)
            self.parts.forget()

    def _of_workers(self, missing: list[int]) -> Iterator[Any]:
        """Yield rows until all are there or a worker has died, whose error is kept in `error`.

        Raises:
            ChildProcessError: A worker raised an error that is none of an image.
        """
        try:
            yield from self._query(missing)
        except NOT_OF_A_ROW:
            raise
        except Exception as error:
            # Daft raises errors of its own kinds for a worker that was killed.
            if _RAISED in str(error):
                raise ChildProcessError(
                    f"A worker failed, not because of an image: {_line(error)}. Workers would fail in the "
                    "same way again. Mend that and repeat the command; parts that are there are kept."
                ) from error
            self.error = error

    def _tell_failure(self, error: Exception, failures: int) -> None:
        """Log that workers have failed, or end the command.

        Raises:
            ChildProcessError: They have too often.
        """
        if failures == ATTEMPTS:
            raise ChildProcessError(
                f"Workers failed {ATTEMPTS} times in a row without a new part, while the images of "
                f"{self._first_images()} were worked on: {_line(error)}. Memory may be short (workers=1 "
                "takes less), or an image ends the process: move it away. Parts that are there are kept."
            ) from error
        logger.warning("Workers failed (%s); the parts that are missing run again.", _line(error))

    def _query(self, missing: list[int]) -> Iterator[Any]:
        """Tables of rows of the missing parts, in any order."""
        frame = self.daft.from_arrow(self._groups(missing))
        if self.daft.runners.get_or_infer_runner_type() == "ray":
            frame = frame.into_partitions(len(missing))
        workers = int(self.config.workers)
        given = (frame["path"], frame["position"], self.places.column)
        found = worker_column(HandsOfPlaces, self.settings, given, workers=workers, batch=1)
        frame = frame.select("row", found.alias("found"))
        for batch in frame.to_arrow_iter(results_buffer_size=2 * workers):
            yield self._rows(batch)

    def _groups(self, missing: list[int]) -> Any:  # noqa: ANN401  # pyarrow.Table
        """Images that are fitted together, a group to a row: the same ones after an interruption."""
        size = int(self.config.batch)
        groups = [
            list(part[start : start + size])
            for part in map(self.parts.expected, missing)
            for start in range(0, len(part), size)
        ]
        columns = {"row": groups} | {
            name: [self.places.table.column(name).take(group).to_pylist() for group in groups]
            for name in ("path", "position")
        }
        arrow = arrow_module()
        kinds = [("row", arrow.int64()), ("path", arrow.string()), ("position", arrow.int64())]
        schema = arrow.schema([(name, arrow.list_(kind)) for name, kind in kinds])
        return arrow.table(columns, schema)

    def _rows(self, batch: Any) -> Any:  # noqa: ANN401  # pyarrow.RecordBatch to pyarrow.Table
        """Rows of some groups, with the fields of the results as columns of their own."""
        rows = batch.column("row").flatten().to_pylist()
        found = batch.column("found").flatten()
        table = self.places.table.take(rows).append_column("row", [rows])
        for name in ("hands", "width", "height", "error"):
            table = table.append_column(name, found.field(name))
        return table

    def _first_images(self) -> str:
        first = self.parts.expected(self.parts.missing()[0])
        paths = self.places.table.column("path").slice(first.start, 1).to_pylist()
        return f"rows {first.start} to {first.stop - 1} ({paths[0]} …)"


def _line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[-1][:200]


def _manifest(
    config: DictConfig, places: Places, parts: PartFiles, summary: dict[str, int]
) -> dict[str, Any]:
    options = settings_of(adapted_to_data(config), _FILES)
    return {
        "version": options["version"],
        "input": places.state(),
        "rows_of_a_part": parts.size,
        "parts": [parts.path(part).name for part in range(parts.count)],
        "counts": summary,
        "options": {key: one for key, one in options["options"].items() if key not in _NO_RESULT},
    }


def _tell(summary: dict[str, int], folder: Path, *, strict: bool) -> None:
    logger.info("%s: %s", folder, ", ".join(f"{name} {count}" for name, count in summary.items()))
    failed, images = summary["failed"], summary["images"]
    text = (
        f"{failed} of {images} images could not be processed; the column `error` of {folder} has the reason "
        "of each."
    )
    if failed and (strict or failed == images):
        raise ValueError(text)
    if failed:
        logger.warning("%s", text)
    if strict:
        refuse_doubts(summary)
