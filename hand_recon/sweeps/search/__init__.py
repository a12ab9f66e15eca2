"""Search of settings by Optuna, each trial a training in a process of its own (decision 95)."""
