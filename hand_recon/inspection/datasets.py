"""Datasets and MANO files on the disk, and whether they are complete."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from hand_recon.data.dexycb.files import SEQUENCES, SUBJECTS
from hand_recon.hand.mano.store import file_name, read_file
from hand_recon.inspection.finding import Finding

FREIHAND: Final = {
    "training": (130_240, "FreiHAND_pub_v2.zip"),
    "evaluation": (3_960, "FreiHAND_pub_v2_eval.zip"),
}
"""Number of images of each part, and the archive that holds its annotations."""

HO3D: Final = {"v3": (83_325, 20_137), "v2": (66_034, 11_524)}
"""Numbers of lines of `train.txt` and `evaluation.txt`, by version."""

DEPTH: Final = 3
"""Levels of folders searched below the given one."""


def look_at_mano(folder: Path) -> list[Finding]:
    """MANO's two hands: converted and readable, not converted yet, or missing.

    Args:
        folder: The folder that `hand_recon.prepare mano` writes to.
    """
    findings = []
    for side in ("right", "left"):
        subject, path = f"MANO {side}", folder / file_name(side)
        if path.is_file():
            try:
                read_file(path)
            except ValueError as error:
                findings.append(Finding(subject, "wrong", str(error)))
            else:
                findings.append(Finding(subject, "good", str(path)))
            continue
        pickles = sorted([*folder.rglob(f"MANO_{side.upper()}*.pkl"), *folder.glob("mano*.zip")])
        if pickles:
            cure = f"python -m hand_recon.prepare mano {pickles[0]}"
            findings.append(Finding(subject, "absent", f"not converted yet: {pickles[0]}", cure))
        else:
            cure = (
                "Not needed for hand=open. Else: python -m hand_recon.prepare mano <mano_v1_2.zip>"
            )
            findings.append(Finding(subject, "absent", f"not in {folder}", cure))
    return findings


def look_at_datasets(folder: Path) -> list[Finding]:
    """FreiHAND, DexYCB and HO3D below a folder, with how much of each is there.

    Args:
        folder: Searched `DEPTH` levels deep; links are followed.
    """
    findings: list[Finding] = []
    for root in _folders(folder, DEPTH):
        for recognise in (_freihand, _ho3d, _dexycb):
            findings += recognise(root)
    named = {finding.subject.split()[0] for finding in findings}
    for name in ("FreiHAND", "DexYCB", "HO3D"):
        if name not in named:
            findings.append(
                Finding(
                    name, "absent", f"not below {folder}", "data/README.md says where to get it."
                )
            )
    return findings


def _folders(folder: Path, depth: int) -> Iterator[Path]:
    """A folder and those below it, without the folders inside a dataset."""
    if not folder.is_dir():
        return
    yield folder
    inside = any(
        (folder / name).exists() for name in ("training_xyz.json", "train.txt", "calibration")
    )
    if depth and not inside:
        with os.scandir(folder) as entries:
            below = sorted(Path(entry.path) for entry in entries if entry.is_dir())
        for path in below:
            yield from _folders(path, depth - 1)


def _freihand(root: Path) -> list[Finding]:
    findings = []
    for part, (expected, archive) in FREIHAND.items():
        # HO3D's ground truth has the same name, but no list of cameras.
        if not all((root / f"{part}_{kind}.json").is_file() for kind in ("xyz", "K")):
            continue
        images = root / part / "rgb"
        if not images.is_dir() and part == "evaluation":
            # The first archive has the evaluation's images, the second one its annotations.
            images = root.with_name(root.name.removesuffix("_eval")) / part / "rgb"
        count = _count(images, (".jpg", ".png"))
        lists = [
            name
            for name in ("K", "xyz", "scale", "verts")
            if (root / f"{part}_{name}.json").is_file()
        ]
        found = f"{count:,} of {expected:,} images, lists {' '.join(lists)}; {root}"
        data = root if part == "training" else images.parents[1]
        check = f"python -m hand_recon.prepare check data=freihand data.root={data}"
        whole = count in (expected, expected // 4 if part == "training" else expected)
        if whole:
            findings.append(Finding(f"FreiHAND {part}", "good", found, check))
        elif not count or count > expected:
            cure = f"Unpack {FREIHAND['training'][1]} again: all images are in it."
            findings.append(Finding(f"FreiHAND {part}", "wrong", found, cure))
        else:
            found += f"\nA set of your own, or {archive} was not unpacked completely"
            findings.append(Finding(f"FreiHAND {part}", "absent", found, check))
    return findings


def _ho3d(root: Path) -> list[Finding]:
    if not all((root / name).is_file() for name in ("train.txt", "evaluation.txt")):
        return []
    lines = tuple(_lines(root / name) for name in ("train.txt", "evaluation.txt"))
    version = "v2" if lines == HO3D["v2"] or "v2" in root.name.lower() else "v3"
    ground_truth = "with" if (root / "evaluation_xyz.json").is_file() else "without"
    expected = HO3D[version]
    found = (
        f"{version}: {lines[0]:,} of {expected[0]:,} training and {lines[1]:,} of {expected[1]:,} evaluation "
        f"frames, {ground_truth} evaluation_xyz.json; {root}"
    )
    cure = f"python -m hand_recon.prepare check data=ho3d data.root={root} data.version={version}"
    if lines == expected:
        return [Finding("HO3D", "good", found, cure)]
    if any(count > most for count, most in zip(lines, expected, strict=True)):
        return [Finding("HO3D", "wrong", found, "Unpack its archive again; is it another version?")]
    return [Finding("HO3D", "absent", f"{found}\nA set of your own, or incomplete", cure)]


def _dexycb(root: Path) -> list[Finding]:
    subjects = [name for name in SUBJECTS if (root / name).is_dir()]
    if not subjects or not (root / "calibration").is_dir():
        return []
    recordings = {
        name: sum(entry.is_dir() for entry in (root / name).iterdir()) for name in subjects
    }
    found = (
        f"{len(subjects)} of {len(SUBJECTS)} subjects, {sum(recordings.values()):,} of "
        f"{SEQUENCES * len(SUBJECTS):,} recordings; {root}"
    )
    check = f"python -m hand_recon.prepare check data=dexycb data.root={root}"
    odd = ", ".join(name for name, count in recordings.items() if count != SEQUENCES)
    if odd:
        # The loader refuses it: a recording's index among the hundred decides its split.
        cure = f"Unpack again the subjects with other than {SEQUENCES} recordings: {odd}."
        return [Finding("DexYCB", "wrong", found, cure)]
    if len(subjects) == len(SUBJECTS):
        return [Finding("DexYCB", "good", found, check)]
    missing = ", ".join(name for name in SUBJECTS if name not in subjects)
    return [
        Finding("DexYCB", "absent", f"{found}\nWithout {missing}", f"{check} data.partial=true")
    ]


def _count(folder: Path, endings: tuple[str, ...]) -> int:
    if not folder.is_dir():
        return 0
    with os.scandir(folder) as entries:
        return sum(entry.name.lower().endswith(endings) for entry in entries)


def _lines(path: Path) -> int:
    return sum(bool(line.strip()) for line in path.read_text(encoding="utf-8").splitlines())
