"""Speed of hand_recon's parts as ratios to plain versions of the published formulas (docs/performance.md).

A suite (`suites/`) is a function from `Settings` to rows; `SUITES` in `suites/__init__.py` names them. Every
comparison runs both sides in turn in one process, so that a busy machine slows both alike, and checks first
that both give the same values.
"""
