"""Plain versions of published formulas, the references of the benchmark."""
