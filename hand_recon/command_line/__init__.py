"""The command line: verbs, the words that follow them, and Hydra behind them. Imports no torch."""
