"""Small datasets in LeRobot's layouts, versions 2 and 3: videos or images whose grey says their number."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
from PIL import Image

from tests.support.video_files import numbered_image, write_clip

LENGTHS = (5, 7)
"""Frames of the two episodes."""

FPS = 10.0
CAMERA = "observation.images.top"


def write_info(folder: Path, version: str, kind: str, **paths: str | None) -> Path:
    """The head of a dataset with one camera."""
    (folder / "meta").mkdir(parents=True)
    features = {
        CAMERA: {"dtype": kind, "shape": [48, 64, 3]},
        "action": {"dtype": "float32", "shape": [6]},
    }
    info = {"codebase_version": version, "fps": FPS, "chunks_size": 1, "features": features} | paths
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def version_2(folder: Path) -> Path:
    """A dataset with a video for each episode, each in a chunk of its own."""
    write_info(
        folder,
        "v2.1",
        "video",
        data_path="data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        video_path="videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    )
    lines = []
    for episode, length in enumerate(LENGTHS):
        lines.append(json.dumps({"episode_index": episode, "tasks": ["wave"], "length": length}))
        video = folder / f"videos/chunk-{episode:03d}/{CAMERA}/episode_{episode:06d}.mp4"
        video.parent.mkdir(parents=True)
        write_clip(video, length, FPS)
    (folder / "meta" / "episodes.jsonl").write_text("\n".join(lines) + "\n")
    return folder


def version_3(folder: Path, *, videos: bool = True) -> Path:
    """A dataset with one file for both episodes: a video, or a table of encoded images."""
    write_info(
        folder,
        "v3.0",
        "video" if videos else "image",
        data_path="data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        video_path="videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    )
    rows: list[dict[str, Any]] = []
    start = 0
    for episode, length in enumerate(LENGTHS):
        row = {"episode_index": episode, "length": length, "stats/action/max": [1.0]}
        for prefix in ("data", f"videos/{CAMERA}"):
            row |= {f"{prefix}/chunk_index": 0, f"{prefix}/file_index": 1}
        row[f"videos/{CAMERA}/from_timestamp"] = start / FPS
        rows.append(row)
        start += length
    table = folder / "meta/episodes/chunk-000/file-000.parquet"
    table.parent.mkdir(parents=True)
    # The table's rows need not be in order.
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows[::-1]), table)
    if videos:
        video = folder / "videos" / CAMERA / "chunk-000/file-001.mp4"
        video.parent.mkdir(parents=True)
        write_clip(video, sum(LENGTHS), FPS)
    else:
        data = folder / "data/chunk-000/file-001.parquet"
        data.parent.mkdir(parents=True)
        write_images(data, sum(LENGTHS), CAMERA, group=4)
    return folder


def write_images(path: Path, count: int, column: str, group: int) -> Path:
    """A Parquet file of encoded images whose grey says their row, in row groups."""
    images = [{"bytes": encoded(numbered_image(row)), "path": f"{row}.png"} for row in range(count)]
    table = pyarrow.table({column: images, "other": list(range(count))})
    pyarrow.parquet.write_table(table, path, row_group_size=group)
    return path


def encoded(pixels: np.ndarray) -> bytes:
    """The bytes of a PNG file."""
    import io

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()
