"""The benchmarks' protocols: official scores, submissions, prediction files and their checks (Sec. 4.1)."""
