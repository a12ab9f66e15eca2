"""The experiments that repeat rows of the paper's Tables 2 and 3."""

from hand_recon.tables.published import TABLE_3A, TABLE_3B, TABLES_2

PAPER_EXPERIMENTS = {
    row.experiment: table.dataset
    for table in (*TABLES_2, TABLE_3A, TABLE_3B)
    for row in table.rows
    if row.experiment is not None
}
"""Dataset of the paper by experiment of Tables 2 and 3."""
