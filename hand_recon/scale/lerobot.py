"""Frames of LeRobot datasets, versions 2 and 3, by the places where they are stored.

Version 2 has a file for each episode and version 3 files of many; `meta/info.json` has the names of both.
A camera is stored as videos, or as images inside the Parquet files of the data.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from hand_recon.data.photos.formats import shown
from hand_recon.reading.text import parse_json, read_text
from hand_recon.scale.extra import parquet_module

INFO: Final = "meta/info.json"
"""File that makes a folder a LeRobot dataset."""


@dataclass(frozen=True)
class LeRobotFrames:
    """Frames of one camera of a dataset, episode by episode."""

    column: str
    """Camera, such as `observation.images.top`."""
    paths: list[str] = field(default_factory=list)
    """Video or Parquet file of each frame."""
    positions: list[int] = field(default_factory=list)
    """Number of the frame in its video, or of the row in its Parquet file."""
    episodes: list[int] = field(default_factory=list)
    """Index of the episode."""
    frames: list[int] = field(default_factory=list)
    """Index of the frame in its episode."""
    times: list[float] = field(default_factory=list)
    """Time since the episode's first frame, seconds."""

    def add(self, episode: int, length: int, path: Path, first: int, fps: float) -> None:
        """Append the frames of an episode.

        Args:
            episode: Index of the episode.
            length: Number of its frames.
            path: File that has them.
            first: Position of the first of them in that file.
            fps: Frames per second.
        """
        name = shown(path.absolute())
        self.paths.extend([name] * length)
        self.positions.extend(range(first, first + length))
        self.episodes.extend([episode] * length)
        self.frames.extend(range(length))
        self.times.extend(number / fps for number in range(length))


def frames_of_dataset(folder: Path, camera: str | None) -> LeRobotFrames:
    """Find the frames of a camera of a dataset.

    Args:
        folder: Folder of the dataset.
        camera: Name of the camera; None if there is one alone.

    Raises:
        ValueError: The dataset has another layout, or the camera is not clear.
    """
    info = _info(folder)
    features: dict[str, Any] = info["features"]
    name = _camera(folder, features, camera)
    found, fps = LeRobotFrames(name), float(info["fps"])
    is_video = features[name]["dtype"] == "video"
    version = str(info.get("codebase_version", "")).lstrip("v")
    if version.startswith("2"):
        layout = _files_of_episodes(folder, info, name, is_video=is_video)
    elif version.startswith("3"):
        layout = _files_of_many(folder, info, name, is_video=is_video)
    else:
        raise ValueError(
            f"{folder} is a LeRobot dataset of the version {info.get('codebase_version')}; expected v2 or "
            "v3. Convert it with LeRobot's own scripts."
        )
    for episode, length, path, first in layout:
        found.add(episode, length, path, first, fps)
    return found


def _info(folder: Path) -> dict[str, Any]:
    path = folder / INFO
    info = parse_json(read_text(path), path)
    if not isinstance(info, dict):
        info = {}
    missing = [key for key in ("features", "fps", "data_path") if key not in info]
    if missing:
        raise ValueError(
            f"{folder / INFO} has no {', '.join(missing)}; expected that of a LeRobot dataset. Copy it again."
        )
    found: dict[str, Any] = info
    return found


def _camera(folder: Path, features: Mapping[str, Any], camera: str | None) -> str:
    cameras = [key for key, one in features.items() if one.get("dtype") in ("video", "image")]
    if camera in cameras:
        return str(camera)
    if camera is None and len(cameras) == 1:
        return cameras[0]
    found = "no camera" if not cameras else f"the cameras {', '.join(cameras)}"
    wanted = "one of them with column=<camera>" if camera is None else f"column={camera} among them"
    raise ValueError(f"{folder} has {found}; expected {wanted}.")


def _files_of_episodes(
    folder: Path, info: Mapping[str, Any], camera: str, *, is_video: bool
) -> Iterator[tuple[int, int, Path, int]]:
    """Version 2: episode, number of frames, file, and 0, for each episode."""
    pattern = str(info["video_path" if is_video else "data_path"])
    chunk = int(info.get("chunks_size", 1000))
    table = folder / "meta/episodes.jsonl"
    for line in read_text(table).splitlines():
        if line.strip():
            entry = parse_json(line, table)
            episode = int(entry["episode_index"])
            name = pattern.format(
                episode_chunk=episode // chunk, episode_index=episode, video_key=camera
            )
            yield episode, int(entry["length"]), folder / name, 0


def _files_of_many(
    folder: Path, info: Mapping[str, Any], camera: str, *, is_video: bool
) -> Iterator[tuple[int, int, Path, int]]:
    """Version 3: episode, number of frames, file, and position of the first frame in it."""
    pattern = str(info["video_path" if is_video else "data_path"])
    prefix = f"videos/{camera}" if is_video else "data"
    starts: dict[Path, int] = {}
    for entry in _episodes(folder):
        episode, length = int(entry["episode_index"]), int(entry["length"])
        path = folder / pattern.format(
            video_key=camera,
            chunk_index=int(entry[f"{prefix}/chunk_index"]),
            file_index=int(entry[f"{prefix}/file_index"]),
        )
        if is_video:
            first = round(float(entry[f"{prefix}/from_timestamp"]) * float(info["fps"]))
        else:
            # Rows of a file are those of consecutive episodes.
            first = starts.get(path, 0)
            starts[path] = first + length
        yield episode, length, path, first


def _episodes(folder: Path) -> list[dict[str, Any]]:
    """Rows of the tables of episodes, in the order of the episodes."""
    files = sorted((folder / "meta/episodes").rglob("*.parquet"))
    rows: list[dict[str, Any]] = []
    for file in files:
        known = parquet_module().ParquetFile(file)
        with known:
            # Beside these, there are statistics of every feature.
            wanted = [
                name
                for name in known.schema_arrow.names
                if name in ("episode_index", "length") or name.startswith(("data/", "videos/"))
            ]
            rows += known.read(columns=wanted).to_pylist()
    if not rows:
        raise ValueError(
            f"{folder} has no table in meta/episodes; expected those of a LeRobot dataset of version 3. Copy "
            "it again."
        )
    return sorted(rows, key=lambda row: int(row["episode_index"]))
