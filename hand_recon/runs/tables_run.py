"""Writes finished runs as the paper's Tables 1 to 3 (Sec. 4.2, 4.3, 5)."""

import logging
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from hand_recon.runs.configuration import check_extra
from hand_recon.tables.beside import beside
from hand_recon.tables.collection import collect
from hand_recon.tables.documents import Comparison, write_documents
from hand_recon.tables.intervals import Bootstrap
from hand_recon.tables.studies import Compared
from hand_recon.tables.summary import summarise
from hand_recon.tables.terminal import show

logger = logging.getLogger(__name__)


def report(config: DictConfig) -> dict[str, Any]:
    """Collect runs, print their tables and write them.

    Args:
        config: `conf/report.yaml` composed.

    Returns:
        The files that were written, the number of runs per study, which of Tables 2 and 3 there are, and
        what was left out and why.

    Raises:
        FileNotFoundError: What `runs` names does not exist.
        ValueError: No run is finished.
        FileExistsError: The output folder holds a report.
    """
    check_extra("matplotlib", "jinja2")
    compared = Compared(tuple(config.method), tuple(config.ignored))
    found = collect(config.runs, Path(config.paths.output), compared)
    logger.info("Runs are taken from %s", ", ".join(found.sources))
    bootstrap = Bootstrap(config.bootstrap.resamples, config.bootstrap.seed)
    summaries = tuple(summarise(study, bootstrap) for study in found.studies)
    comparison = Comparison(summaries, found.left_out, beside(found.studies))
    files = write_documents(comparison, Path(config.output).absolute())
    show(comparison)
    logger.info("Open %s", files[0])
    return {
        "files": [str(path) for path in files],
        "runs": [len(study.runs) for study in found.studies],
        "tables": [one.table.title for one in comparison.beside],
        "left_out": {str(one.folder): one.reason for one in found.left_out},
    }
