"""Fitted hands as the file format of hands holds them, with a verdict on each."""

import numpy as np
import torch
from torch import Tensor

from hand_recon import __version__
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.verdict import verdicts


def to_records(hands: FittedHands) -> HandRecords:
    """Records of fitted hands, judged."""
    judged = verdicts(hands, [origin.image_size for origin in hands.origins])
    found, parameters, fitted = hands.prediction, hands.prediction.parameters, hands.fitted
    observed, origins = hands.observed, hands.origins

    def numbers(values: Tensor) -> np.ndarray:
        kept = fitted.reshape(-1, *[1] * (values.ndim - 1))
        return values.double().masked_fill(~kept, torch.nan).numpy()

    covariance = found.covariance_3d
    if covariance is None:
        covariance = torch.full((len(hands), 21, 3, 3), torch.nan)
    given = observed.landmarks_2d.masked_fill(~observed.labelled[..., None], torch.nan)
    return HandRecords(
        names=observed.names,
        images=tuple(origin.image for origin in origins),
        sides=tuple("left" if left else "right" for left in observed.left.tolist()),
        verdicts=tuple(verdict.value for verdict in judged),
        reasons=tuple(verdict.reasons for verdict in judged),
        score=np.array(
            [np.nan if one.score is None else one.score for one in origins], dtype=float
        ),
        landmarks_3d=numbers(found.landmarks_3d),
        landmarks_2d=numbers(found.landmarks_2d),
        observed_2d=given.double().numpy(),
        sigma_2d=numbers(hands.sigma_2d),
        covariance_3d=numbers(covariance),
        joint_angles_degrees=numbers(parameters.joint_angles.rad2deg()),
        shape=numbers(parameters.shape),
        root_rotation=numbers(parameters.root_rotation),
        translation=numbers(parameters.translation),
        # As it was given, not as it came back from the crops.
        intrinsics=numbers(
            found.intrinsics if observed.intrinsics is None else observed.intrinsics
        ),
        cameras=tuple(
            origin.camera if known else None
            for origin, known in zip(origins, fitted.tolist(), strict=True)
        ),
        image_sizes=tuple(origin.image_size for origin in origins),
        residual=numbers(hands.distance.nanmean(dim=1)),
        loss={name: numbers(value) for name, value in hands.loss.items()},
        sources=tuple(origin.source for origin in origins),
        hand_models=tuple(origin.hand_model for origin in origins),
        versions=(__version__,) * len(hands),
        moments=tuple(origin.moment for origin in origins),
    )
