"""`hand-recon predict`: one process, or `engine=daft` for many images (docs/scale.md)."""

from typing import Any

from omegaconf import DictConfig


def predict(config: DictConfig) -> dict[str, Any]:
    """Reconstruct the hands of photographs or a video by the engine that the configuration names.

    Args:
        config: `conf/predict.yaml` composed.

    Raises:
        ValueError: There is no such engine, or the errors of the one that runs.
    """
    # Each engine is imported when it is used: Daft is an extra.
    if config.engine is None:
        from hand_recon.runs.predict_run import predict as predict_here

        return predict_here(config)
    if config.engine != "daft":
        raise ValueError(
            f"engine={config.engine} is unknown; expected daft, or null for one process."
        )
    from hand_recon.scale.engine import predict_in_parts

    return predict_in_parts(config)
