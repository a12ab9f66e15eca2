"""Score a checkpoint on its own test hands, or on another dataset's (Sec. 4.1).

python -m hand_recon.evaluate ckpt=outputs/train/<time>
python -m hand_recon.evaluate ckpt=… data=freihand data.root=/path/to/FreiHAND_pub_v2
"""

from typing import Any

import hydra
import lightning
from omegaconf import DictConfig, OmegaConf, open_dict

from hand_recon.checkpoints import load_trained
from hand_recon.configuration import (
    CONF,
    build_data,
    check_input,
    claim_folder,
    set_threads,
    use_cache,
)
from hand_recon.progress import quiet_libraries
from hand_recon.results import Run, finish_run


def evaluate(config: DictConfig) -> dict[str, Any]:
    """Score a checkpoint.

    Args:
        config: `conf/evaluate.yaml` composed.

    Returns:
        What `metrics.json` holds.

    Raises:
        ValueError: No checkpoint was given.
    """
    if OmegaConf.is_missing(config, "ckpt"):
        raise ValueError(
            "Which checkpoint? Give ckpt=<file or folder of a run>, "
            "for example ckpt=outputs/train/<time>."
        )
    quiet_libraries()
    set_threads(config.threads)
    other_data = config.get("data") is not None
    loaded = load_trained(config.ckpt, config.data.landmarks if other_data else None)
    trained = loaded.config
    lightning.seed_everything(trained.seed, workers=True, verbose=False)
    folder = claim_folder(config.paths.run)
    with open_dict(trained):
        trained.paths, trained.report, trained.name = config.paths, config.report, config.name
        if other_data:
            trained.data = config.data
        use_cache(trained.data, config.paths.cache)
        trained.trainer = config.trainer
    # The constant predictor is of the data that the checkpoint was trained on.
    mean = None if other_data else loaded.mean_pose
    facts = {"checkpoint": str(config.ckpt)}
    data = build_data(trained)
    check_input(loaded.module, data)
    return finish_run(Run(trained, folder, loaded.module, data, mean, facts))


@hydra.main(version_base="1.3", config_path=CONF, config_name="evaluate")
def main(config: DictConfig) -> None:
    """The command line."""
    evaluate(config)


if __name__ == "__main__":
    main()
