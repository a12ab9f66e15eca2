"""The verbs of `hand-recon`, and what each accepts besides Hydra's overrides."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Verb:
    """One command: `hand-recon <name>`, the same as `python -m hand_recon.<name>`."""

    name: str
    """The word after `hand-recon`, a module of `hand_recon` and a file of `conf`."""
    group: str
    """The heading under which `hand-recon --help` lists it."""
    purpose: str
    """One line for `hand-recon --help`."""
    entry: str
    """Function that receives the composed configuration, as `module:function`."""
    positional: tuple[str, ...] = ()
    """Configuration keys that words without a key are given to, in order."""
    paths: tuple[str, ...] = ()
    """Further keys whose values are paths: quoted for Hydra, `~` expanded."""
    many: str | None = None
    """Configuration key of a list that takes all words without a key, in place of `positional`."""
    together: bool = False
    """True if processes that a launcher such as torchrun started share the work."""
    lists: tuple[str, ...] = ()
    """Keys of lists of names, which may be written with commas alone, `key=a,b`, as sweeps are in Hydra."""

    @property
    def path_keys(self) -> frozenset[str]:
        """All keys whose values are paths."""
        many = () if self.many is None else (self.many,)
        return frozenset({*self.positional, *self.paths, *COMMON_PATHS, *many})


COMMON_PATHS: Final = (
    "paths.run",
    "paths.output",
    "paths.cache",
    "hydra.run.dir",
    "hydra.sweep.dir",
)
"""Paths that every verb knows."""

DATA_PATHS: Final = (
    "data.root", "data.eval_root", "data.train", "data.val", "data.test", "data.images", "data.mano",
    "data.cache_dir", "hand.path", "photos.train", "photos.val", "photos.test", "photos.images",
)  # fmt: skip
"""Paths of datasets and of the licensed hand."""

HANDS: Final = "Get hands"
MODELS: Final = "Train and measure"
DATA: Final = "Prepare"

VERBS: Final = {
    verb.name: verb
    for verb in (
        Verb(
            "predict", HANDS, "photographs in, 3D hands out; no training",
            "hand_recon.scale.start:predict", (),
            (
                "output", "camera", "detector.landmarks", "detector.boxes", "detector.models", "lifter",
                "ckpt", "hand.path",
            ),
            "input",
        ),
        Verb(
            "fit", HANDS, "2D landmarks of any detector in, 3D hands out; no training",
            "hand_recon.runs.fit_run:fit", ("landmarks",),
            ("output", "intrinsics", "images", "lifter", *DATA_PATHS),
        ),
        Verb(
            "export", HANDS, "hands as files of other programs: GLB, BVH, USD, OpenSim, OpenXR, MANO, ...",
            "hand_recon.runs.export_run:export", ("source",), ("output", "hand.path"), lists=("format",),
        ),
        Verb(
            "demo", HANDS, "a local web page: photographs, the webcam, and knowledge step by step",
            "hand_recon.page.start:demo", ("results",),
            ("detector.landmarks", "detector.boxes", "detector.models", "camera", "hand.path"),
        ),
        Verb(
            "train", MODELS, "train, test the best checkpoint, draw a report",
            "hand_recon.runs.recorded_training:train_recorded", (),
            ("resume", "from_run", "start_from", "model.encoder.weights", *DATA_PATHS), together=True,
        ),
        Verb(
            "search", MODELS, "settings of a training by Optuna, scored on the validation hands",
            "hand_recon.sweeps.search.run:search", (),
            ("folder", "start_from", "model.encoder.weights", *DATA_PATHS),
        ),
        Verb(
            "evaluate", MODELS, "test a checkpoint on its own data or on another dataset",
            "hand_recon.runs.evaluation_run:evaluate", ("ckpt",), DATA_PATHS, together=True,
        ),
        Verb(
            "score", MODELS, "score and check anybody's file of predictions as its benchmark does",
            "hand_recon.runs.scoring_run:score", ("predictions", "ground_truth"),
            ("output", *DATA_PATHS),
        ),
        Verb(
            "audit", MODELS, "how plausible hand poses of any origin are, and the nearest plausible ones",
            "hand_recon.runs.audit.audit_run:audit", (), ("output", "ranges", "hand.path"), "files",
        ),
        Verb(
            "report", MODELS, "finished runs as the paper's Tables 1 to 3",
            "hand_recon.runs.tables_run:report", ("runs",), ("output",),
        ),
        Verb(
            "figures", MODELS, "finished runs as the paper's Fig. 3 and 4",
            "hand_recon.runs.figures_run:figures", ("runs",), ("output",),
        ),
        Verb(
            "benchmark", MODELS, "speed on this machine, as ratios to the published formulas",
            "hand_recon.speed.run:benchmark", (), ("output", "baseline", "ckpt"), lists=("suite",),
        ),
        Verb(
            "doctor", DATA, "what this machine has, what is missing, and what to type next",
            "hand_recon.runs.diagnosis:doctor_command", ("folder",), ("dexycb", "mano"),
        ),
        Verb(
            "prepare", DATA, "label photographs, fetch the detector, convert MANO, fill caches, check labels",
            "hand_recon.runs.preparation:prepare", ("task", "source"),
            (
                "folder", "images", "labels", "fields", "output", "detector.landmarks", "detector.boxes",
                "detector.models", *DATA_PATHS,
            ),
        ),
    )
}  # fmt: skip
"""Every verb by its name, in the order of the help."""
