"""Classes of Daft whose instances each worker process makes once.

They are at the top of their module, so that a worker imports them by name: a class that is made inside of a
function would be sent with all that it refers to.
"""

import logging
from collections.abc import Sequence
from typing import Any, TypeVar

from hand_recon.scale.extra import arrow_module, daft_module
from hand_recon.scale.schema import audit_type, fit_type, group_type, image_type

Worker = TypeVar("Worker")


class HandsOfImages:
    """Hands of a column of images."""

    kind = staticmethod(image_type)
    """Function that makes Arrow's type of a row."""

    def __init__(self, settings: dict[str, Any]) -> None:
        # Inside, since the process that plans needs no networks.
        from hand_recon.scale.image_worker import ImageWorker

        self.worker = in_own_process(ImageWorker(settings))

    def rows(self, images: Any, intrinsics: Any) -> Any:  # noqa: ANN401  # daft.Series, or a value
        """Reconstruct the hands of images."""
        from hand_recon.scale.image_worker import ImageTask

        values = images.to_pylist()
        cameras = column_values(intrinsics, len(values))
        tasks = [ImageTask(*pair) for pair in zip(values, cameras, strict=True)]
        return arrow_module().array(self.worker(tasks), self.kind())


class HandsOfPlaces:
    """Hands of groups of images, each image by its place, and each group a row."""

    kind = staticmethod(group_type)
    """Function that makes Arrow's type of a row."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.worker = HandsOfImages(settings).worker

    def rows(self, paths: Any, positions: Any, column: Any) -> Any:  # noqa: ANN401
        """Reconstruct the hands of each group, whose hands are fitted together."""
        from hand_recon.scale.image_worker import ImageTask

        groups = zip(paths.to_pylist(), positions.to_pylist(), strict=True)
        found = [
            self.worker(
                [
                    ImageTask({"path": path, "position": position, "column": column})
                    for path, position in zip(*group, strict=True)
                ]
            )
            for group in groups
        ]
        return arrow_module().array(found, self.kind())


class HandsOfLandmarks:
    """Hands fitted to a column of 2D landmarks."""

    kind = staticmethod(fit_type)
    """Function that makes Arrow's type of a row."""

    def __init__(self, settings: dict[str, Any]) -> None:
        from hand_recon.scale.landmark_worker import LandmarkWorker

        self.worker = in_own_process(LandmarkWorker(settings))

    def rows(self, landmarks: Any, side: Any, confidence: Any, intrinsics: Any) -> Any:  # noqa: ANN401
        """Fit hands to landmarks."""
        from hand_recon.scale.landmark_worker import LandmarkTask

        values = landmarks.to_pylist()
        given = [column_values(one, len(values)) for one in (side, confidence, intrinsics)]
        tasks = [LandmarkTask(*row) for row in zip(values, *given, strict=True)]
        return arrow_module().array(self.worker(tasks), self.kind())


class AuditsOfHands:
    """Verdicts on a column of 3D landmarks."""

    kind = staticmethod(audit_type)
    """Function that makes Arrow's type of a row."""

    def __init__(self, settings: dict[str, Any]) -> None:
        from hand_recon.scale.audit_worker import AuditWorker

        self.worker = in_own_process(AuditWorker(settings))

    def rows(self, landmarks: Any, side: Any) -> Any:  # noqa: ANN401
        """Audit hands."""
        from hand_recon.scale.audit_worker import AuditTask

        values = landmarks.to_pylist()
        sides = column_values(side, len(values))
        tasks = [AuditTask(*pair) for pair in zip(values, sides, strict=True)]
        return arrow_module().array(self.worker(tasks), self.kind())


Column = type[HandsOfImages] | type[HandsOfPlaces] | type[HandsOfLandmarks] | type[AuditsOfHands]
"""A class whose `rows` makes one column of others."""


def worker_column(
    column: Column, settings: dict[str, Any], given: Sequence[Any], *, workers: int, batch: int
) -> Any:  # noqa: ANN401  # daft.Expression
    """Column that worker processes make.

    Args:
        column: Class of the workers.
        settings: Settings of each.
        given: Columns, and values for all rows, that `rows` takes.
        workers: Number of processes.
        batch: Rows at once.

    Raises:
        ModuleNotFoundError: Daft is not installed.
        ValueError: There is no worker, or no row at once.
    """
    for name, number in (("workers", workers), ("batch", batch)):
        if number < 1:
            raise ValueError(f"Found {name}={number}; expected 1 or more.")
    daft = daft_module()
    # The marks are read by the call below, so that two columns may have batches of different sizes.
    kind = daft.DataType.from_arrow_type(column.kind())
    daft.method.batch(return_dtype=kind, batch_size=batch)(column.rows)
    # A process each: threads of one process would wait for each other.
    made = daft.cls(column, use_process=True, max_concurrency=workers)
    return made(settings).rows(*given)


def column_values(given: Any, count: int) -> Sequence[Any]:  # noqa: ANN401  # a series, or one value
    """Values of a column that is a series, or one value for all rows.

    Args:
        given: A series of Daft, or a value.
        count: Number of rows.
    """
    return given.to_pylist() if hasattr(given, "to_pylist") else [given] * count


def in_own_process(worker: Worker) -> Worker:
    """Adapt a process that works on columns alone: one thread of OpenCV, and errors in the table only.

    Args:
        worker: The worker, which is returned.
    """
    import cv2

    cv2.setNumThreads(1)
    # What is wrong with an image is in its row.
    logging.getLogger("hand_recon.runs.looking").setLevel(logging.CRITICAL)
    return worker
