"""OmegaConf resolvers that the configuration files use."""

import hashlib
import re
from collections.abc import Mapping
from typing import Any, Final

from omegaconf import OmegaConf

from hand_recon.command_line.precision import fast_precision, fused_step

MANO_HAND: Final = "hand_recon.hand.mano.hand.mano_hand"
"""Target of `hand=mano`. The datasets number the vertices of their meshes like this hand."""

LONGEST_NAME: Final = 200
"""Bytes of a folder's name; common file systems allow 255."""


def register_resolvers() -> None:
    """Register every resolver of `conf`; it may be called again."""
    # Used by the sweep folders of conf/train.yaml, evaluate.yaml and fit.yaml.
    OmegaConf.register_new_resolver("folder_name", folder_name, replace=True)
    # Used by conf/data: surfaces of a dataset are compared with a hand of the same numbering only.
    OmegaConf.register_new_resolver(
        "numbering", lambda target: "mano" if target == MANO_HAND else "open", replace=True
    )
    # Used by conf/recipe/photos.yaml.
    OmegaConf.register_new_resolver("fast_precision", fast_precision, replace=True)
    # Used by conf/recipe/lifter.yaml and photos.yaml.
    OmegaConf.register_new_resolver("fused_step", fused_step, replace=True)
    # Used by conf/fit.yaml, predict.yaml and descent.
    OmegaConf.register_new_resolver("lifter_beside", lifter_beside, replace=True)
    OmegaConf.register_new_resolver("has_all_knowledge", has_all_knowledge, replace=True)
    # Used by conf/fit.yaml and predict.yaml.
    OmegaConf.register_new_resolver("landmarks_beside", landmarks_beside, replace=True)


def lifter_beside(prior: Mapping[str, Any]) -> str:
    """Default of `lifter` beside a prior: `default` with all of the paper's knowledge (Eq. 5), else `none`.

    The packaged lifter knows how hands bend, and its start would lend that to a fit without.

    Args:
        prior: A member of the group `prior`: settings of the terms by name, none for one that is left out.
    """
    return "default" if has_all_knowledge(prior) else "none"


def landmarks_beside(target: str) -> str:
    """Default of `landmark_set` beside a hand: `mediapipe`, or `mano` for MANO, which has no other landmarks.

    Args:
        target: `_target_` of a member of the group `hand`.
    """
    return "mano" if target == MANO_HAND else "mediapipe"


def has_all_knowledge(prior: Mapping[str, Any]) -> bool:
    """True if a prior has all of the paper's knowledge (Eq. 5).

    Args:
        prior: A member of the group `prior`: settings of the terms by name, none for one that is left out.
    """
    ranges = prior.get("range_of_motion") or {}
    terms = (ranges, ranges.get("anatomy"), prior.get("non_penetration"), prior.get("shape"))
    return all(terms)


def folder_name(overrides: str) -> str:
    """A run's overrides as the name of its folder, in characters that a later override may contain.

    `seed=2,experiment=ablation_row1` becomes `experiment-ablation_row1__seed-2`. A name that file systems
    find too long ends in a digest.
    """
    # Hydra sorts overrides by name; the experiment says most and comes first.
    words = overrides.replace("+", "").split(",")
    words.sort(key=lambda word: not word.startswith("experiment="))
    name = re.sub(r"[^\w.-]+", "-", "__".join(words)).strip("-")
    if len(name.encode()) <= LONGEST_NAME:
        return name
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    return f"{name.encode()[: LONGEST_NAME - 9].decode(errors='ignore')}-{digest}"
