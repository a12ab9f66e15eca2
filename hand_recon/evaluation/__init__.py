"""How good a reconstruction is: alignment, the benchmarks' protocols, metrics (Sec. 4.1)."""
