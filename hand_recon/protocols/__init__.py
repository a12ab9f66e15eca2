"""The benchmarks' protocols: official scores, submissions, prediction files and their lint (Sec. 4.1)."""
